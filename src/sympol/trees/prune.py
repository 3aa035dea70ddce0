"""Pruning: smaller trees that act the same.

`prune` removes

1. splits decided already: by an ancestor on the same feature or on the same group, or by the bounds of the
   observation space;
2. redundant splits: replacing the node by one of its children changes no action.

Decided by an ancestor is true of every observation, NaN and infinities included: left of ``x <= t`` means
``x <= s`` for every s >= t (and no NaN), right of it means that ``x <= s`` fails for every s <= t (and for
NaN). Of a group exactly one feature is 1: below "front is lava" nothing else is left to ask of the front, and
where all categories but one are ruled out, it is that one. Decided by the bounds is true of every observation
within them, both ends included, and of no others: an observation below ``feature_low``, above ``feature_high``
or NaN may get another action afterwards. Infinite bounds decide nothing. `sympol.trees.regions` keeps account.

Redundant splits are found from the leaves up, by descending both sides at once: each cell of one side is compared
with the action of the other, up to the first cell with two actions. Two equal leaves are the smallest case. If
either side can replace both, the smaller one stays.

Pruning is idempotent: what stays was neither decided nor redundant among the observations that reached it, and
removing a split above can only add observations.

`prune_on` does the same for a list of all observations that can occur. Groups and bounds do not capture everything
that cannot be seen; where an environment is small enough to list its observations, the list does.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from .actions import ActionSpec, BoxActions
from .base import BaseTree, TreeT
from .floats import SMALLEST_NORMAL, flushed, observation_batch
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD, descend, paths
from .regions import Region, Way

if TYPE_CHECKING:
    from jaxtyping import Int
    from numpy.typing import ArrayLike

# Steps of a comparison, for each leaf of both sides, after which a split counts as not idle. Sides of the same
# shape need 7; a tree made for it could need as many as it has pairs of leaves.
_PATIENCE, _LEAST_PATIENCE = 64, 10_000


@dataclass(eq=False)
class _Leaf:
    """A leaf under construction: its action, as bytes, and its visits, if they are known."""

    value: np.ndarray
    action: bytes
    visits: int | None
    n_leaves: int = 1


@dataclass(eq=False)
class _Split:
    """An inner node under construction."""

    feature: int
    threshold: float
    left: _Node | None = None
    right: _Node | None = None
    n_leaves: int = 0

    def side(self, way: Way) -> _Node:
        child = self.left if way == "left" else self.right
        assert child is not None
        return child


_Node: TypeAlias = _Split | _Leaf


def prune(tree: TreeT, *, bounds: bool = True, merge: bool = True) -> TreeT:
    """Return the smaller tree with the same deterministic action everywhere in the observation space.

    Merged leaves get the visit-weighted mean of their probabilities where visits are known and the action stays, else
    the outputs of the leaf with more visits. Visits outside the bounds are dropped. Where the visits of one leaf would
    have to be divided among several, all visits are dropped; `DecisionTree.with_visits` counts them again.

    Args:
        tree: The tree.
        bounds: Whether only observations within the bounds count; otherwise all in which each group is one-hot.
        merge: Whether leaves with the same action may become one; otherwise every reachable leaf keeps its outputs.

    Returns:
        The pruned tree.
    """
    work, region = _work(tree), Region(tree, bounds=bounds)
    done: list[_Node] = []
    # a node to begin with, a side to enter, None to leave it, a split to finish after both
    awaited: list[int | tuple[_Split, Way] | _Split | None] = [0]
    while awaited:
        match awaited.pop():
            case int(node):
                split = work[node]
                if isinstance(split, _Leaf):
                    done.append(split)
                    continue
                left, right = int(tree.children_left[node]), int(tree.children_right[node])
                way = region.way(split.feature, split.threshold)
                if way is not None:
                    awaited.append(left if way == "left" else right)
                else:
                    awaited += [split, None, right, (split, "right"), None, left, (split, "left")]
            case (split, way):
                region.enter(split.feature, split.threshold, way)
            case None:
                region.leave()
            case split:
                split.right, split.left = done.pop(), done.pop()
                split.n_leaves = split.left.n_leaves + split.right.n_leaves
                done.append(_survivor(tree.actions, split, region) if merge else split)
    return _rebuild(tree, _preorder(done.pop()))


def prune_unvisited(tree: TreeT) -> TreeT:
    """Remove the branches without visits. This CHANGES the policy on observations that were never seen.

    Args:
        tree: A tree with visits; `DecisionTree.with_visits` counts them.

    Returns:
        The pruned tree.

    Raises:
        ValueError: If the tree has no visits.
    """
    visits = tree.n_node_samples
    if visits is None or visits[0] == 0:
        raise ValueError("the tree knows no visits; count them first: tree.with_visits(observations)")
    work, kept, awaited = _work(tree), [], [0]
    while awaited:
        node = awaited.pop()
        children = [] if tree.is_leaf[node] else [tree.children_right[node], tree.children_left[node]]
        visited = [child for child in children if visits[child] > 0]
        if len(visited) == len(children):
            kept.append(work[node])
        awaited += visited
    return _rebuild(tree, kept)


def _work(tree: BaseTree) -> list[_Node]:
    """Return the nodes of a tree, not yet linked."""
    values, decided = tree.leaf_outputs, tree.leaf_actions
    visits = [None] * tree.n_nodes if tree.n_node_samples is None else tree.n_node_samples.tolist()
    return [
        _Leaf(values[node], decided[node].tobytes(), visits[node])
        if leaf
        else _Split(int(tree.feature[node]), float(tree.threshold[node]))
        for node, leaf in enumerate(tree.is_leaf)
    ]


def _survivor(actions: ActionSpec, split: _Split, region: Region) -> _Node:
    """Return the smaller side that can replace both, with the visits of the other added, or the split itself."""
    orders: list[tuple[Way, Way]] = [("left", "right"), ("right", "left")]
    for kept, dropped in sorted(orders, key=lambda order: split.side(order[0]).n_leaves):
        answered_by = _answered_by(split.side(kept), split, dropped, region)
        if answered_by is not None:
            for leaf, by in answered_by.items():
                _add_visits(actions, leaf, by)
            return split.side(kept)
    return split


def _answered_by(keep: _Node, split: _Split, way: Way, region: Region) -> dict[_Leaf, list[_Leaf]] | None:
    """Return the leaves of `keep` that replace each leaf on this side; None if an action differs somewhere."""
    answered_by: dict[_Leaf, list[_Leaf]] = {}
    other, depth = split.side(way), region.depth
    patience = _LEAST_PATIENCE + _PATIENCE * (keep.n_leaves + other.n_leaves)
    # two nodes for the same observations, those that go this way at a split; None to leave that side
    awaited: list[tuple[_Node, _Node, _Split, Way] | None] = [None, (keep, other, split, way)]
    while awaited:
        step = awaited.pop()
        if step is None:
            region.leave()
            continue
        region.enter(step[2].feature, step[2].threshold, step[3])
        (a, steps), (b, more_steps) = _undecided(step[0], region), _undecided(step[1], region)
        patience -= 1 + steps + more_steps
        if isinstance(a, _Split):
            awaited += [None, (a.side("right"), b, a, "right"), None, (a.side("left"), b, a, "left")]
        elif isinstance(b, _Split):
            awaited += [None, (a, b.side("right"), b, "right"), None, (a, b.side("left"), b, "left")]
        elif a.action == b.action and patience > 0:
            answered_by.setdefault(b, []).append(a)
        else:
            while region.depth > depth:
                region.leave()
            return None
    return answered_by


def _undecided(node: _Node, region: Region) -> tuple[_Node, int]:
    """Descend as long as all observations of the region go the same way; return the node and the number of steps."""
    steps = 0
    while isinstance(node, _Split) and (way := region.way(node.feature, node.threshold)) is not None:
        node, steps = node.side(way), steps + 1
    return node, steps


def _add_visits(actions: ActionSpec, leaf: _Leaf, answered_by: list[_Leaf]) -> None:
    """Add the visits of a removed leaf to the leaves that replace it."""
    kept = answered_by[0]
    if len({*answered_by}) == 1:
        if leaf.visits is None or kept.visits is None:
            kept.visits = None
        else:
            kept.value = _common_value(actions, kept, leaf)
            kept.visits += leaf.visits
    elif leaf.visits != 0:
        for kept in answered_by:
            kept.visits = None


def _common_value(actions: ActionSpec, a: _Leaf, b: _Leaf) -> np.ndarray:
    """Return common outputs for two leaves with the same action and known visits."""
    assert a.visits is not None
    assert b.visits is not None
    more_visited = a.value if a.visits >= b.visits else b.value
    if isinstance(actions, BoxActions) or a.visits + b.visits == 0:
        return more_visited
    chances = actions.probabilities(np.stack([a.value, b.value]))
    parts = chances if isinstance(chances, tuple) else (chances,)
    mean = np.concatenate([np.average(part, axis=0, weights=[a.visits, b.visits]) for part in parts])
    logits = flushed(np.log(np.maximum(mean, SMALLEST_NORMAL)))
    # a mean of probabilities can tie, or order two components otherwise than both of its parts
    return logits if actions.decide(logits[None])[0].tobytes() == a.action else more_visited


def _preorder(root: _Node) -> Iterator[_Node]:
    awaited: list[_Node] = [root]
    while awaited:
        yield (node := awaited.pop())
        if isinstance(node, _Split):
            awaited += [node.side("right"), node.side("left")]


def _rebuild(tree: TreeT, preorder: Iterable[_Node]) -> TreeT:
    """Pack nodes in preorder into the arrays of a tree."""
    nodes = list(preorder)
    n_nodes = len(nodes)
    left, right = np.full(n_nodes, NO_CHILD), np.full(n_nodes, NO_CHILD)
    feature, threshold = np.full(n_nodes, NO_FEATURE), np.full(n_nodes, NO_THRESHOLD)
    value = np.zeros((n_nodes, tree.actions.n_outputs), np.float32)
    visits = np.zeros(n_nodes, np.int64)
    known = True
    roots: list[int] = []
    for i, node in reversed(list(enumerate(nodes))):
        if isinstance(node, _Split):
            left[i], right[i] = roots.pop(), roots.pop()
            feature[i], threshold[i] = node.feature, node.threshold
            visits[i] = visits[left[i]] + visits[right[i]]
        else:
            value[i], visits[i] = node.value, node.visits or 0
            known &= node.visits is not None
        roots.append(i)
    return replace(
        tree,
        children_left=left,
        children_right=right,
        feature=feature,
        threshold=threshold,
        value=value,
        n_node_samples=visits if known else None,
    )


def prune_on(tree: TreeT, observations: ArrayLike, *, merge: bool = True) -> TreeT:
    """Return the smaller tree with the same deterministic action on each of these observations.

    On all others it may act differently. A split is removed where one of its sides gives the same actions for all
    observations that reach it; if either side does, the smaller one stays. Leaves keep their outputs, visits are
    dropped: `DecisionTree.with_visits` counts them.

    Args:
        tree: The tree.
        observations: All observations that can occur, [batch, features].
        merge: Whether leaves with the same action may replace each other.

    Returns:
        The pruned tree.

    Raises:
        ValueError: If there are no observations, they have another shape, or a group is not one-hot in them.
        TypeError: If they do not hold numbers.
    """
    X, _ = observation_batch(observations, tree.n_features)
    if len(X) == 0:
        raise ValueError("there must be at least one observation to prune on, got none")
    X = np.unique(X, axis=0)
    leaf = np.atleast_1d(tree.apply(X))
    answer = _numbered(tree.leaf_actions) if merge else np.arange(tree.n_nodes)
    wanted = answer[leaf]
    come_by = paths(tree.children_left, tree.children_right, leaf).T
    left, right = tree.children_left.copy(), tree.children_right.copy()
    in_place, n_leaves = np.arange(tree.n_nodes), np.ones(tree.n_nodes, int)
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        sides = left[node], right[node] = int(in_place[left[node]]), int(in_place[right[node]])
        n_leaves[node] = n_leaves[[*sides]].sum()
        here = come_by[node]
        for side in sorted(sides, key=lambda side: n_leaves[side]):
            found = descend(left, right, tree.feature, tree.threshold, X[here], side)
            if (answer[found] == wanted[here]).all():
                in_place[node] = side
                break
    return select_nodes(tree, left, right, int(in_place[0]))


def _numbered(actions: np.ndarray) -> Int[np.ndarray, " nodes"]:
    """Return a number for each action, equal where the actions are equal bit for bit."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(action.tobytes(), len(numbers)) for action in actions])


def select_nodes(
    tree: TreeT, left: Int[np.ndarray, " nodes"], right: Int[np.ndarray, " nodes"], root: int
) -> TreeT:
    """Return the tree of the nodes that changed links reach from ``root``, without visits.

    Args:
        tree: The tree whose nodes are kept or left out.
        left: The left child of each node, [nodes]; -1 at leaves.
        right: The right child of each node, [nodes]; -1 at leaves.
        root: The node that becomes the root.

    Returns:
        The tree, its nodes in preorder.
    """
    order, awaited = [], [root]
    while awaited:
        order.append(node := awaited.pop())
        if left[node] != NO_CHILD:
            awaited += [right[node], left[node]]
    position = np.full(tree.n_nodes, NO_CHILD)
    position[order] = np.arange(len(order))
    leaf = left[order] == NO_CHILD
    return replace(
        tree,
        children_left=np.where(leaf, NO_CHILD, position[left[order]]),
        children_right=np.where(leaf, NO_CHILD, position[right[order]]),
        feature=tree.feature[order],
        threshold=tree.threshold[order],
        value=tree.leaf_outputs[order],
        n_node_samples=None,
    )
