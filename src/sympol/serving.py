"""Serve a tree: with stable-baselines3's ``predict``, and inside a Gymnasium environment."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, final

import gymnasium
import numpy as np

from .envs.registry import resolve
from .envs.spaces import Features, action_spec
from .envs.spec import EnvSpec
from .play import fitted_actions, sample_actions
from .trees import DecisionTree
from .trees.actions import ActionSpec, BoxActions, DiscreteActions
from .trees.text import leaf_conditions, rule_words

TreeOrPath: TypeAlias = DecisionTree | str | PathLike[str]


@final
class SymbolicPolicy:
    """A tree that answers observations as an environment returns them, through stable-baselines3's ``predict``.

    Args:
        tree: A `DecisionTree`, its JSON file, or the folder of a run.
        env: What is observed and done: an id, an `EnvSpec`, or anything with spaces, such as an environment or a vector
            of them. Then any observation of its space will do, and actions have its dtype and are within its bounds.
            Without one, observations are rows of numbers, in the order of ``tree.feature_names``.
        seed: Seeds the actions that are drawn if ``deterministic`` is False.

    Raises:
        ValueError: The file holds no tree, or the tree is not for this environment.
        OSError: The file cannot be read.
    """

    def __init__(self, tree: TreeOrPath, env: Any = None, *, seed: int | None = None) -> None:
        self.tree = tree if isinstance(tree, DecisionTree) else _read(Path(tree))
        self._spaces = None if env is None else _spaces(env)
        if self._spaces is not None:
            _require_fit(self.tree, *self._spaces)
        self._rng = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        """Return the action for an observation, or actions for a batch of them.

        Args:
            observation: One observation of the environment's space; or a batch, with leading axes on every array.
            state: Returned as it is, for compatibility: a tree has no memory.
            episode_start: Not used.
            deterministic: Whether to take the best action or to sample from the leaf's distribution.

        Returns:
            The action or actions, and ``state``.

        Raises:
            ValueError, TypeError: The observation is not of the environment's space, or not what the tree takes.
        """
        x = np.asarray(observation) if self._spaces is None else self._spaces[0].flatten(observation)
        if x.shape == (0,):  # an empty list
            x = x.reshape(0, self.tree.n_features)
        rows = x.reshape(-1, x.shape[-1]) if x.ndim else x
        actions = self.tree.predict(rows) if deterministic else sample_actions(self.tree, rows, self._rng)
        actions = actions.reshape((*x.shape[:-1], *actions.shape[1:]))[()]
        return actions if self._spaces is None else fitted_actions(actions, self._spaces[1]), state


class Decision(TypedDict):
    """The decision of a tree in one observation."""

    leaf: int
    """The number of the leaf reached."""
    rule: str
    """The rule of this leaf, as in `DecisionTree.rules`."""
    action: Any
    """The action of the tree."""
    overridden: bool
    """Whether another action was taken."""


@final
class RecordDecisions(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment in which a tree acts and explains itself; ``step(action)`` overrules it.

    ``info["decision"]`` of a step is the `Decision` that the tree took, or would have taken, on the observation before
    it; ``decision`` is the next one.

    Args:
        env: The environment.
        tree: A `DecisionTree`, its JSON file, or the folder of a run.

    Raises:
        ValueError: The tree is not for this environment.
    """

    def __init__(self, env: gymnasium.Env, tree: TreeOrPath) -> None:
        super().__init__(env)
        self.policy = SymbolicPolicy(tree, env)
        tree = self.policy.tree
        self._features = Features.of(env.observation_space)
        self._rules = {leaf: rule_words(tree, leaf, known) for leaf, known in leaf_conditions(tree)}
        self._observation: Any = None

    @property
    def decision(self) -> Decision:
        """The action that the tree would take now, and its rule.

        Raises:
            RuntimeError: It is asked for before the first ``reset``.
        """
        if self._observation is None:
            raise RuntimeError("there is nothing to decide yet: call reset() first")
        leaf = int(self.policy.tree.apply(self._features.flatten(self._observation)))
        action, _ = self.policy.predict(self._observation)
        return {"leaf": leaf, "rule": self._rules[leaf], "action": action, "overridden": False}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: As in Gymnasium.
            options: As in Gymnasium.

        Returns:
            The first observation, and ``info``.
        """
        self._observation, info = self.env.reset(seed=seed, options=options)
        return self._observation, info

    def step(self, action: Any = None) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take the tree's action, or another one.

        Args:
            action: The action to take instead of the tree's.

        Returns:
            Observation, reward, terminated, truncated, and ``info`` with the `Decision` as ``"decision"``.
        """
        decision = self.decision
        if action is not None:
            decision["overridden"] = not np.array_equal(action, decision["action"])
        taken = decision["action"] if action is None else action
        self._observation, reward, terminated, truncated, info = self.env.step(taken)
        return self._observation, reward, terminated, truncated, {**info, "decision": decision}


def _read(path: Path) -> DecisionTree:
    file = path / "policy.json" if path.is_dir() else path
    try:
        return DecisionTree.from_json(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{file} holds no tree: {error}") from error


def _spaces(env: Any) -> tuple[Features, gymnasium.Space]:
    """Return how observations become features, and the space of actions."""
    if isinstance(env, str):
        env = resolve(env, backend="host")
    if isinstance(env, EnvSpec):
        return env.features, env.action_space
    spaces: list[Any] = [
        getattr(env, f"single_{name}", getattr(env, name, None))
        for name in ("observation_space", "action_space")
    ]
    if not all(isinstance(space, gymnasium.Space) for space in spaces):
        raise TypeError(
            f"env must be an id, an EnvSpec or something with observation_space and action_space, got {env!r}"
        )
    observed, taken = spaces
    return Features.of(observed), taken


def _require_fit(tree: DecisionTree, features: Features, space: gymnasium.Space) -> None:
    """Raise ValueError if a tree has other features or actions than an environment."""
    if tree.n_features != len(features.names):
        raise ValueError(
            f"the tree sees {tree.n_features} features {list(tree.feature_names)[:8]}, but the environment shows "
            f"{len(features.names)}: {list(features.names)[:8]}; give the environment it was made for"
        )
    taken = action_spec(space)
    if _kind(tree.actions) != _kind(taken):
        raise ValueError(
            f"the tree's actions are {tree.actions}, but the environment takes {space}; give the environment it was "
            "made for"
        )


def _kind(actions: ActionSpec) -> tuple[object, ...]:
    """Return what identifies an action space, without names and noise."""
    if isinstance(actions, BoxActions):
        return BoxActions, actions.shape
    size = actions.n if isinstance(actions, DiscreteActions) else actions.nvec
    return type(actions), size, actions.start
