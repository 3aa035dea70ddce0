"""Training within a limit of size: `Config.max_nodes` and `Config.node_price`.

The first half of a training is free, or the first quarter where rollouts grow. At the validation after it
(`prune_step`) the best tree so far is pruned by return (`sympol.search.prune_by_return`), and the training continues in
that shape: with the same critic, optimiser and compiled program, and with a validation that only knows trees of this
shape. A tree that is requested before that moment is pruned by the same rule when it is requested.

The small tree lies inside the complete tree that is trained: nodes outside its shape are closed. A closed node sends
everything to one side: all its thresholds are `MASKED`, or minus that, a number that no feature reaches and no
optimiser moves; and the slope of the surrogate is 0 there, so that nothing is learnt. The trained tree stays one
compiled program, whatever its shape. Only NaN and infinities would go to the other side. A tree that is read out
(`extract_unmasked`) has no closed nodes.

Every tree that pruning makes of a complete one lies in it, because pruning only puts a side in the place of its split.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32

from ..algorithms.config import Config
from ..algorithms.state import TrainState
from ..algorithms.work import stops
from ..envs.spec import EnvSpec
from ..policies.action_units import multiply_outputs, units_and_centers
from ..policies.extract import extract_tree
from ..policies.tree import MASKED, Tree
from ..trees import DecisionTree
from ..trees.preorder import complete_order
from ..trees.prune import select_nodes
from .evaluators import make_evaluator
from .prune_by_return import prune_by_return

FREE, FREE_GROWING = 0.5, 0.25
"""The part of a training before the limit is imposed. Where rollouts and batches grow (`Config.dynamic_rollout`), most
updates come early: after half of the steps too few would be left to recover the loss by pruning."""


def has_limit(config: Config) -> bool:
    """Return True where a training has a limit of size that is imposed by pruning.

    A tree that grows (`Config.grow_splits`) never exceeds its limit.
    """
    return (config.max_nodes > 0 and not config.grow_splits) or config.node_price > 0


def prune_step(config: Config) -> int:
    """Return the timestep of the first validation at which the limit is imposed."""
    free = FREE_GROWING if config.dynamic_rollout else FREE
    return next(stop for stop in stops(config) if stop >= free * config.total_timesteps)


def is_due(config: Config, before: int, now: int) -> bool:
    """Return whether pruning is due.

    Args:
        config: The configuration of the training.
        before: The timestep of the last validation.
        now: The timestep of this one.

    Returns:
        True where the limit is imposed between the two.
    """
    return has_limit(config) and before < prune_step(config) <= now


def tree_within_limit(
    tree: DecisionTree, timestep: int, spec: EnvSpec, config: Config, seed: int
) -> DecisionTree:
    """Return the tree of a training at a timestep, pruned by return if the limit is not imposed yet.

    Args:
        tree: The tree.
        timestep: Environment steps of the training so far.
        spec: The environment, in which the episodes of the pruning are played.
        config: The configuration, which may have no limit.
        seed: The seed of those episodes.

    Returns:
        The tree, within the limit.
    """
    is_imposed = not has_limit(config) or timestep >= prune_step(config)
    return tree if is_imposed else prune_within(tree, spec, config, seed)


def prune_within(tree: DecisionTree, spec: EnvSpec, config: Config, seed: int) -> DecisionTree:
    """Prune a tree by return until it is within the limit of a configuration.

    Args:
        tree: The tree.
        spec: Its environment.
        config: The configuration with the limit.
        seed: The seed of the episodes that are played.

    Returns:
        The pruned tree; the tree itself, pruned exactly, where it is within the limit already.
    """
    listed = spec.all_observations()
    tree = tree.prune(observations=listed)
    if not config.node_price and tree.n_nodes <= config.max_nodes:
        return tree
    return prune_by_return(
        tree,
        make_evaluator(spec, seed),
        max_nodes=config.max_nodes or None,
        node_price=config.node_price,
        observations=listed,
    ).tree


def mask_state(state: TrainState, full: DecisionTree, spec: EnvSpec, config: Config, seed: int) -> TrainState:
    """Return a training state that continues with the best tree so far, pruned.

    Nothing of the pruned tree is validated yet, and learning rates that were halved are reset.

    Args:
        state: The state of the training.
        full: The best tree so far, extracted as a whole.
        spec: The environment.
        config: The configuration with the limit.
        seed: The seed of the episodes that pruning plays.

    Returns:
        The state whose actor has the shape of the pruned tree.
    """
    best: Any = state.validation.best_actor if config.select_best else state.networks.actor
    small = prune_within(full, spec, config, seed)
    spare = 0 if config.node_price else max(0, config.max_nodes - small.n_nodes) // 2
    shift, scale = (np.asarray(part) for part in state.normalizer)
    units, _ = units_and_centers(spec.action_space, scaled=config.scale_actions)
    masked = mask_nodes(multiply_outputs(best, units), shift, scale, small, spare)
    actor = eqx.tree_at(lambda a: a.log_std, multiply_outputs(masked, 1 / units), best.log_std)
    validation = state.validation._replace(
        best_return=jnp.float32(-jnp.inf),
        best_actor=actor,
        num_bad=jnp.int32(0),
        lr_factor=jnp.float32(1),
    )
    return state._replace(networks=state.networks._replace(actor=actor), validation=validation)


def extract_unmasked(actor: Tree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """Extract the tree of an actor without its closed nodes.

    Args:
        actor: The actor.
        shift: The shift of each feature ``[features]``, as of `extract_tree`.
        scale: The scale of each feature ``[features]``.
        **metadata: Names, bounds and actions of the tree.

    Returns:
        The tree.
    """
    thresholds = np.asarray(actor.thresholds)
    closed = (thresholds == -MASKED).all(axis=1).astype(int) - (thresholds == MASKED).all(axis=1)
    bare = np.where(closed[:, None] == 0, thresholds, 0)
    full = extract_tree(eqx.tree_at(lambda a: a.thresholds, actor, bare), shift, scale, **metadata)
    side = np.append(closed, np.zeros(len(closed) + 1, int))[complete_order(len(closed))]
    left, right = full.children_left.copy(), full.children_right.copy()
    in_place = np.arange(full.n_nodes)
    for node in np.flatnonzero(~full.is_leaf)[::-1]:
        left[node], right[node] = in_place[left[node]], in_place[right[node]]
        if side[node]:  # -1 to the left, 1 to the right
            in_place[node] = left[node] if side[node] < 0 else right[node]
    return select_nodes(full, left, right, int(in_place[0]))


def mask_nodes(
    actor: Tree, shift: np.ndarray, scale: np.ndarray, small: DecisionTree, spare: int = 0
) -> Tree:
    """Give a complete tree the shape and the leaves of a small one that was pruned out of it.

    Args:
        actor: The complete tree.
        shift: The shift of each feature ``[features]``, as of `extract_tree`.
        scale: The scale of each feature ``[features]``.
        small: The small tree.
        spare: So many more splits stay open, where there is room below the leaves of the small tree. Both their sides
            have the same outputs at first, and training can make use of them.

    Returns:
        The complete tree with all other nodes closed.

    Raises:
        ValueError: The small tree was not pruned out of this one.
    """
    full = extract_tree(actor, shift, scale, actions=small.actions)
    inner = np.argsort(complete_order(len(actor.thresholds)))[: len(actor.thresholds)]
    shape = _Shape(small, full.feature[inner], full.threshold[inner])
    shape.lay(0, 0)
    for _ in range(spare):
        shape.open_one()
    values = np.array(actor.leaf_values)
    for above, small_leaf in shape.ends.items():
        first, last = _leaves_below(above, len(inner))
        alike = (values[first:last] == small.leaf_outputs[small_leaf]).all(axis=1)
        leaf = first + int(np.argmax(alike))  # where none is alike, the first
        values[leaf] = small.leaf_outputs[small_leaf]
        shape.close_between(above, leaf + len(inner))
    side, thresholds = shape.side[:, None], np.asarray(actor.thresholds)
    thresholds = np.where(side < 0, np.float32(MASKED), np.where(side > 0, np.float32(-MASKED), thresholds))
    made = jnp.asarray(thresholds), jnp.asarray(values)
    return eqx.tree_at(lambda a: (a.thresholds, a.leaf_values), actor, made)


class _Shape:
    """The position of a small tree in a complete one, whose nodes are counted level by level."""

    def __init__(
        self,
        small: DecisionTree,
        feature: Int32[np.ndarray, " splits"],
        threshold: Float32[np.ndarray, " splits"],
    ) -> None:
        self.small = small
        self.side = np.zeros(len(feature), int)
        """The side to which each node is closed: -1 left, 1 right, 0 open."""
        self.ends: dict[int, int] = {}
        """Nodes below which only one leaf is left, and the small tree's leaf there."""
        self._nodes_of: dict[tuple[int, float], list[int]] = {}
        for node, split in enumerate(zip(feature.tolist(), threshold.tolist(), strict=True)):
            self._nodes_of.setdefault(split, []).append(node)
        self._found: dict[tuple[int, int], int | None] = {}

    def lay(self, node: int, above: int) -> None:
        """Put the small tree's subtree of ``node`` in the place of the complete tree's subtree of ``above``."""
        if self.small.is_leaf[node]:
            self.ends[above] = node
            return
        at = self._place(node, above)
        if at is None:
            raise ValueError("the tree does not lie in the complete one: it was not pruned out of it")
        self.close_between(above, at)
        self.lay(int(self.small.children_left[node]), 2 * at + 1)
        self.lay(int(self.small.children_right[node]), 2 * at + 2)

    def open_one(self) -> None:
        """Leave the uppermost split below a leaf of the small tree open, if there is any."""
        at = min(self.ends)
        if at < len(self.side):
            small_leaf = self.ends.pop(at)
            self.ends[2 * at + 1] = self.ends[2 * at + 2] = small_leaf

    def close_between(self, above: int, node: int) -> None:
        """Close the nodes from ``above`` on that lead to ``node``."""
        while node != above:
            parent = (node - 1) // 2
            self.side[parent] = -1 if node == 2 * parent + 1 else 1
            node = parent

    def _place(self, node: int, above: int) -> int | None:
        """Return the node of the complete tree with the same split, below which the whole subtree of ``node`` lies."""
        if self.small.is_leaf[node]:
            return above
        if (node, above) not in self._found:
            self._found[node, above] = next(self._places(node, above), None)
        return self._found[node, above]

    def _places(self, node: int, above: int) -> Iterator[int]:
        small = self.small
        left, right = int(small.children_left[node]), int(small.children_right[node])
        for at in self._nodes_of.get((int(small.feature[node]), float(small.threshold[node])), []):
            sides = ((left, 2 * at + 1), (right, 2 * at + 2))
            if _is_below(at, above) and all(self._place(*side) is not None for side in sides):
                yield at


def _is_below(node: int, above: int) -> bool:
    while node > above:
        node = (node - 1) // 2
    return node == above


def _leaves_below(node: int, n_inner: int) -> tuple[int, int]:
    """Return the first leaf below a node of a complete tree, and the one after the last, counted from 0."""
    first = last = node
    while first < n_inner:
        first, last = 2 * first + 1, 2 * last + 2
    return first - n_inner, last - n_inner + 1
