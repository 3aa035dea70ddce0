"""Warm starts: training that begins with a tree, be it trained, distilled, edited or written by hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from ..envs.spec import EnvSpec
from ..policies.action_units import multiply_outputs, units_and_centers
from ..policies.embed import embed, leaf_logits, places
from ..policies.tree import Tree
from ..trees import DecisionTree
from ..trees.actions import ActionSpec, BoxActions
from ..trees.override import nodes_reached_by
from .config import Config
from .knobs import ConfigError
from .split_growth import closed
from .state import Normalizer, TrainState, WarmStartState, tree_where


@dataclass(frozen=True)
class Start:
    """A tree to train on from, and how. Before the first update the policy is that tree, action for action.

    Args:
        tree: A tree of any shape, not deeper than the config's depth.
        freeze: Nodes of the tree that stay as they are: splits keep feature and threshold, leaves their values.
        confidence: The probability that a leaf's best action gets where it is almost 1 (`leaf_logits`). Frozen leaves
            keep theirs.
        critic_warmup: The part of the training, from 0 to less than 1, in which only the critic learns; an untrained
            critic would mislead the tree.
        origin: A description of the tree's origin.
        origin_return: The mean return of the tree there, if it is known.

    Raises:
        ValueError: The tree has no such node, or a number is out of its range.
    """

    tree: DecisionTree
    freeze: tuple[int, ...] = ()
    confidence: float = 0.7
    critic_warmup: float = 0.05
    origin: str = ""
    origin_return: float | None = None

    def __post_init__(self) -> None:
        """Check."""
        object.__setattr__(self, "freeze", _checked_nodes(self.freeze, self.tree))
        if not 0 <= self.critic_warmup < 1:
            raise ValueError(
                "critic_warmup must be from 0 to less than 1, a part of the training, got "
                f"{self.critic_warmup}"
            )
        leaf_logits(self.tree, self.confidence)  # raises

    def fitted(self, spec: EnvSpec) -> Start:
        """Return the same start with the names and bounds of an environment.

        Args:
            spec: The environment.

        Returns:
            The start, its tree described as the environment's.

        Raises:
            ValueError: The tree is for other features or actions.
        """
        tree, features = self.tree, spec.features
        _check_features(tree, spec)
        _check_actions(tree.actions, spec.actions, spec.name)
        actions = spec.actions
        if isinstance(actions, BoxActions) and isinstance(tree.actions, BoxActions):
            actions = replace(actions, std=tree.actions.std)
        return replace(self, tree=replace(tree, actions=actions, **features.metadata()))

    def check(self, config: Config) -> None:
        """Check that a policy of a config can start from the tree.

        Args:
            config: The config.

        Raises:
            ConfigError: The policy is no tree, the tree is too deep, splits are to be grown, or nodes are frozen that
                a size limit would prune.
        """
        if config.policy != "tree":
            raise ConfigError(
                f"only a tree can start from a tree; policy is {config.policy!r}, leave start out"
            )
        if config.method != "direct":
            raise ConfigError(
                f"method must be direct for a training that starts from a tree, got {config.method!r}: it needs no "
                "teacher"
            )
        if config.grow_splits and self.freeze:
            raise ConfigError(
                "grow_splits must be False for a training that starts from a tree with frozen nodes, got True"
            )
        if self.freeze and (config.max_nodes or config.node_price):
            raise ConfigError(
                f"nodes {', '.join(map(str, self.freeze))} are frozen, and max_nodes or node_price would prune "
                "some: leave one of the two out"
            )
        if self.tree.depth > config.depth:
            raise ConfigError(
                f"the tree to start from has depth {self.tree.depth}, which does not fit into depth {config.depth}: "
                f"choose --depth {self.tree.depth} (in Python depth={self.tree.depth}), or prune it"
            )

    def deepened(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return a preset's values with a depth into which the tree fits.

        Args:
            values: Fields of a config by name.

        Returns:
            The values, with a depth of at least the tree's.
        """
        return {**values, "depth": max(values.get("depth", Config.depth), self.tree.depth)}

    def about(self) -> dict[str, Any]:
        """Return the start as a run's config stores it; the tree is in a file beside it.

        Returns:
            Plain values for TOML.
        """
        known = {} if self.origin_return is None else {"return_mean": self.origin_return}
        return {
            "origin": self.origin,
            **known,
            "freeze": list(self.freeze),
            "confidence": float(self.confidence),
            "critic_warmup": float(self.critic_warmup),
        }

    @classmethod
    def from_about(cls, tree: DecisionTree, about: dict[str, Any]) -> Start:
        """Return the start that `about` described.

        Args:
            tree: The tree.
            about: The result of `about`.

        Returns:
            The start.

        Raises:
            KeyError: An entry is missing.
            TypeError: An entry is unknown or has another type.
            ValueError: An entry is out of its range.
        """
        known = dict(about)
        origin_return, freeze = known.pop("return_mean", None), known.pop("freeze")
        return cls(tree, freeze=tuple(freeze), origin_return=origin_return, **known)

    def parameters(self, config: Config, seed: int, space: gymnasium.Space) -> tuple[Tree, WarmStartState]:
        """Compute the parameters of the actor that training begins with, on the host.

        Args:
            config: The config of the training.
            seed: The seed of the training, for the splits that the tree does not have.
            space: The action space, whose range is the unit of continuous actions.

        Returns:
            The actor over raw observations, and the state that keeps its frozen parts.
        """
        where = places(self.tree, config.depth)
        frozen = np.isin(np.arange(self.tree.n_nodes), self.freeze)
        actor: Tree = embed(
            self.tree,
            depth=config.depth,
            rng=np.random.default_rng(seed),
            confidence=self.confidence,
            kept_leaves=frozen,
            log_std=config.log_std_init,
            surrogate=config.surrogate,
            temperature=config.temperature,
        )
        units, _ = units_and_centers(space, scaled=config.scale_actions)
        actor = multiply_outputs(actor, 1 / units)
        kept = where.split >= 0
        if config.grow_splits:
            actor = closed(actor, ~kept)
        leaves = (self.tree.is_leaf & frozen)[where.leaf]
        splits = np.where(kept, frozen[where.split], _all_below(leaves))
        warm: Any = (kept, splits, leaves, np.float32(self.critic_warmup))
        return jax.tree.map(np.asarray, actor), WarmStartState(*warm)


def start_of(start: DecisionTree | Start | None, freeze: Iterable[int] | str, spec: EnvSpec) -> Start | None:
    """Make a `Start` of a user's arguments, with the names of an environment.

    Args:
        start: A tree, a `Start`, or None for a random beginning.
        freeze: Nodes of the tree, or a condition that selects them.
        spec: The environment.

    Returns:
        The start, or None.

    Raises:
        ValueError: ``freeze`` is given without a tree or names nodes that it does not have, or the tree is for other
            features or actions.
        TypeError: ``start`` is something else.
    """
    if start is None:
        if freeze:
            raise ValueError(f"freeze is about the tree to start from: give start, too; got {freeze!r}")
        return None
    if not isinstance(start, DecisionTree | Start):
        raise TypeError(
            f"start must be a DecisionTree or a sympol.Start, got {start!r}; read a file with "
            "sympol.DecisionTree.from_json(text)"
        )
    fitted = (Start(start) if isinstance(start, DecisionTree) else start).fitted(spec)
    nodes = nodes_reached_by(fitted.tree, freeze) if isinstance(freeze, str) else freeze
    return replace(fitted, freeze=(*fitted.freeze, *nodes))


def install_actor(state: TrainState, actor: Tree, warm: WarmStartState | None) -> TrainState:
    """Return a new state that begins with an actor over raw observations.

    Args:
        state: The state of a training that begins at random.
        actor: The tree to start from, as a complete tree.
        warm: What is to be remembered of it.

    Returns:
        The state; its features are scaled once the first chunk of experience is there (`data_init.init_from_tree`).
    """
    shift, scale = state.normalizer
    return state._replace(
        networks=state.networks._replace(actor=actor),
        normalizer=Normalizer(jnp.zeros_like(shift), jnp.ones_like(scale)),
        validation=state.validation._replace(best_actor=actor),
        warm=warm,
    )


def install_teacher(state: TrainState, given: TrainState) -> TrainState:
    """Return a new state that begins where a teacher stopped.

    Args:
        state: The state of a training that begins at random.
        given: The distilled tree over raw observations, the teacher's critic, the memory with its scale of
            returns, the steps spent so far, and the record of the teacher.

    Returns:
        The state; where nothing was distilled its actor is the random one.
    """
    assert given.guide is not None
    begun = install_actor(state, given.networks.actor, given.warm)
    begun = tree_where(given.guide.is_distilled, begun, state._replace(warm=given.warm))
    networks = begun.networks._replace(critic=given.networks.critic)
    return begun._replace(networks=networks, memory=given.memory, timestep=given.timestep, guide=given.guide)


def _all_below(leaves: Bool[np.ndarray, " leaves"]) -> Bool[np.ndarray, " inner"]:
    """Return, for each split of a complete tree, whether all leaves below it are marked."""
    levels = [leaves]
    while levels[-1].size > 1:
        left, right = levels[-1].reshape(-1, 2).T
        levels.append(left & right)
    return np.concatenate(levels[:0:-1])


def _checked_nodes(nodes: Sequence[int], tree: DecisionTree) -> tuple[int, ...]:
    for node in nodes:
        if isinstance(node, bool) or not isinstance(node, int | np.integer) or not 0 <= node < tree.n_nodes:
            raise ValueError(
                f"freeze must hold numbers of nodes of the tree to start from, 0 to {tree.n_nodes - 1}, got {node!r}"
            )
    return tuple(sorted({int(node) for node in nodes}))


def _check_features(tree: DecisionTree, spec: EnvSpec) -> None:
    features = spec.features
    if tree.n_features != len(features.names):
        raise ValueError(
            f"the tree to start from looks at {tree.n_features} features, but {spec.name} has {len(features.names)}"
        )
    numbered = tuple(f"x[{i}]" for i in range(tree.n_features))
    if tree.feature_names not in (features.names, numbered):
        i = next(
            i
            for i, names in enumerate(zip(tree.feature_names, features.names, strict=True))
            if len(set(names)) > 1
        )
        raise ValueError(
            f"the tree to start from calls feature {i} {tree.feature_names[i]!r}, but in {spec.name} it is "
            f"{features.names[i]!r}; is it a tree for another environment? If not, give the environment the tree's "
            "names: feature_names=tree.feature_names"
        )
    ours, theirs = ({group.features for group in groups} for groups in (features.groups, tree.groups))
    if not theirs <= ours:
        raise ValueError(
            f"in the tree to start from features {sorted(theirs - ours)[0]} are one-hot, but not in {spec.name}; "
            "give the environment the tree's groups: groups=tree.groups"
        )


def _check_actions(ours: ActionSpec, theirs: ActionSpec, name: str) -> None:
    """Raise unless a tree's actions are the environment's, whatever they are called where they have no names."""
    plain = [replace(actions, **_nameless(actions)) for actions in (ours, theirs)]
    if plain[0] != plain[1]:
        raise ValueError(f"the tree to start from acts by {ours}, but {name} takes {theirs}")
    if ours.names not in (theirs.names, plain[0].names):
        raise ValueError(
            f"the tree to start from calls its actions {', '.join(map(repr, ours.names))}, but in {name} they are "
            f"{', '.join(map(repr, theirs.names))}; if they are the same, give the environment the tree's names: "
            "action_names=tree.actions.names"
        )


def _nameless(actions: ActionSpec) -> dict[str, Any]:
    if isinstance(actions, BoxActions):
        return {"names": (), "std": None}
    return {"names": ()} | ({"options": ()} if hasattr(actions, "options") else {})
