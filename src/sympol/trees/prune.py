"""Smaller trees that act the same.

`prune` removes

1. splits decided already: by an ancestor on the same feature or on the same group, or by the bounds of the
   observation space;
2. idle splits: those whose one side, asked for both, gives the same actions.

Decided by an ancestor is true of every observation, NaN and infinities included: left of ``x <= t`` means
``x <= s`` for every s >= t (and no NaN), right of it means that ``x <= s`` fails for every s <= t (and for
NaN). Of a group exactly one feature is 1: below "front is lava" nothing else is left to ask of the front, and
where all categories but one are ruled out, it is that one. Decided by the bounds is true of every observation
within them, both ends included, and of no others: an observation below ``feature_low``, above ``feature_high``
or NaN may get another action afterwards. Infinite bounds decide nothing. `sympol.trees.regions` keeps account.

Idle splits are found from the leaves up, by walking through both sides at once: as an observation of the one
side would be answered by the other, cell by cell, up to the first cell with two actions. Two equal leaves are
the smallest case. If either side can answer for both, the smaller one stays.

After one call nothing is left for another: what stays was neither decided nor idle among the observations that
came by it, and more observations may come by it once a split above is gone, never fewer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from .actions import ActionSpec, BoxActions
from .base import BaseTree, TreeT
from .floats import SMALLEST_NORMAL, flushed
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .regions import Region, Way

# Steps of a comparison, for each leaf of both sides, after which a split counts as not idle. Sides of the same
# shape need 7; a tree made for it could need as many as it has pairs of leaves.
_PATIENCE, _LEAST_PATIENCE = 64, 10_000


@dataclass(eq=False)
class _Leaf:
    """A leaf under work: what it does, as bytes, and how many came by, if that is known."""

    value: np.ndarray
    action: bytes
    visits: int | None
    n_leaves: int = 1


@dataclass(eq=False)
class _Split:
    """An inner node under work, linked to its children from `left` and `right` on."""

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
    """Return the smaller tree that acts the same, deterministically, within the bounds of the space.

    Without ``bounds`` it acts the same on every observation in which each group is one-hot; without ``merge``
    every leaf that can be reached keeps its own value. Merged leaves get the visit-weighted mean of their
    probabilities where visits are known and it keeps the action, else the value of the leaf that was visited
    more. Visits that went where the bounds forbid are dropped. Where visits would have to be shared between
    leaves, nobody knows how: then the leaves keep their values, and the tree that is returned knows no visits;
    `DecisionTree.with_visits` counts them again.
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
    """Drop the branches nobody visited. This CHANGES the policy on observations that were never seen.

    Raises:
        ValueError: if the tree does not know its visits; `DecisionTree.with_visits` counts them.
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
    """Unpack the arrays."""
    values, decided = tree.leaf_outputs, tree.leaf_actions
    visits = [None] * tree.n_nodes if tree.n_node_samples is None else tree.n_node_samples.tolist()
    return [
        _Leaf(values[node], decided[node].tobytes(), visits[node])
        if leaf
        else _Split(int(tree.feature[node]), float(tree.threshold[node]))
        for node, leaf in enumerate(tree.is_leaf)
    ]


def _survivor(actions: ActionSpec, split: _Split, region: Region) -> _Node:
    """Return the smaller side that can answer for both, with the other one's visits, or the split itself."""
    orders: list[tuple[Way, Way]] = [("left", "right"), ("right", "left")]
    for kept, dropped in sorted(orders, key=lambda order: split.side(order[0]).n_leaves):
        answered_by = _answered_by(split.side(kept), split, dropped, region)
        if answered_by is not None:
            for leaf, by in answered_by.items():
                _add_visits(actions, leaf, by)
            return split.side(kept)
    return split


def _answered_by(keep: _Node, split: _Split, way: Way, region: Region) -> dict[_Leaf, list[_Leaf]] | None:
    """Return the leaves of `keep` that answer for each leaf on this side; None if somewhere it acts otherwise."""
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
    """Descend as far as all these observations go together; return that node, and how far it was."""
    steps = 0
    while isinstance(node, _Split) and (way := region.way(node.feature, node.threshold)) is not None:
        node, steps = node.side(way), steps + 1
    return node, steps


def _add_visits(actions: ActionSpec, leaf: _Leaf, answered_by: list[_Leaf]) -> None:
    """Add the visits of a leaf that is dropped to the leaves that answer in its place."""
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
    """Return one value for two leaves that act the same, and whose visits are known."""
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
