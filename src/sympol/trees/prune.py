"""Smaller trees that act the same.

`prune` removes, in this order,

1. splits decided already: by an ancestor on the same feature, or by the bounds of the observation space;
2. idle splits: those whose one side, asked for both, gives the same actions.

Decided by an ancestor is true of every observation, NaN and infinities included: left of ``x <= t`` means
``x <= s`` for every s >= t (and no NaN), right of it means that ``x <= s`` fails for every s <= t (and for
NaN). Decided by the bounds is true of every observation within them, both ends included, and of no others: an
observation below ``feature_low``, above ``feature_high`` or NaN may get another action afterwards. Infinite
bounds decide nothing.

Idle splits are found from the leaves up. Below a split on feature f, left of t, all thresholds of f are less
than t (the others were decided). So an observation on the right, sent into the left subtree, would fail all
its comparisons of f. If the left subtree without them equals the right subtree, split by split and action by
action, the left one can answer for both; and the other way round. Two equal leaves are the smallest case.
After one pass of each step nothing is left for another.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Literal, TypeAlias

import numpy as np

from .actions import ActionSpec, BoxActions
from .floats import SMALLEST_NORMAL, flushed
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .tree import DecisionTree


@dataclass
class _Leaf:
    """A leaf under work: what it does, as bytes, and how many came by."""

    value: np.ndarray
    action: bytes
    visits: int


@dataclass
class _Split:
    """An inner node under work; `_merged` links it to its children."""

    feature: int
    threshold: float
    left: _Node | None = None
    right: _Node | None = None


_Node: TypeAlias = _Split | _Leaf
_Way: TypeAlias = Literal["left", "right"]


def prune(tree: DecisionTree, *, bounds: bool = True, merge: bool = True) -> DecisionTree:
    """Return the smaller tree that acts the same, deterministically, within the bounds of the space.

    Without ``bounds`` it acts the same on every observation at all; without ``merge`` every leaf that can be
    reached keeps its own value. Merged leaves get the visit-weighted mean of their probabilities where
    visits are known and it keeps the action, else the value of the leaf that was visited more. Visits
    that went where the bounds forbid are dropped.
    """
    nodes = _undecided(tree, bounds=bounds)
    return _rebuild(tree, list(_walk(_merged(tree, nodes))) if merge else nodes)


def prune_unvisited(tree: DecisionTree) -> DecisionTree:
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


def _work(tree: DecisionTree) -> list[_Node]:
    """Unpack the arrays."""
    decided = tree.actions.decide(tree.value)
    visits = np.zeros(tree.n_nodes, np.int64) if tree.n_node_samples is None else tree.n_node_samples
    return [
        _Leaf(tree.value[node], decided[node].tobytes(), int(visits[node]))
        if leaf
        else _Split(int(tree.feature[node]), float(tree.threshold[node]))
        for node, leaf in enumerate(tree.is_leaf)
    ]


def _undecided(tree: DecisionTree, *, bounds: bool) -> list[_Node]:
    """Return the nodes in preorder without the splits that the way to them, or the bounds, decide."""
    # x is known to be NaN or greater than `above`, and, unless that is infinite, at most `most`
    space = [(-math.inf, math.inf)] * tree.n_features
    if bounds:
        ends = zip(tree.feature_low.tolist(), tree.feature_high.tolist(), strict=True)
        space = [(math.nextafter(low, -math.inf), high) for low, high in ends]
    work, kept = _work(tree), []
    awaited: list[tuple[int, dict[int, tuple[float, float]]]] = [(0, {})]
    while awaited:
        node, known = awaited.pop()
        split = work[node]
        if isinstance(split, _Leaf):
            kept.append(split)
            continue
        feature, threshold = split.feature, split.threshold
        left, right = int(tree.children_left[node]), int(tree.children_right[node])
        above, most = known.get(feature, space[feature])
        if threshold <= above:
            awaited.append((right, known))
        elif most <= threshold:
            awaited.append((left, known))
        else:
            kept.append(split)
            awaited.append((right, {**known, feature: (threshold, most)}))
            awaited.append((left, {**known, feature: (above, threshold)}))
    return kept


def _merged(tree: DecisionTree, nodes: list[_Node]) -> _Node:
    """Link the nodes, leave out the idle splits, return the root; no split may be decided."""
    done: list[_Node] = []
    for node in reversed(nodes):
        if isinstance(node, _Split):
            node.left, node.right = done.pop(), done.pop()
            node = _survivor(tree, node)
        done.append(node)
    return done.pop()


def _survivor(tree: DecisionTree, split: _Split) -> _Node:
    """Return the side that can answer for both, with the other one's visits added, or the split itself."""
    assert split.left is not None
    assert split.right is not None
    sides: list[tuple[_Node, _Node, _Way]]
    sides = [(split.left, split.right, "right"), (split.right, split.left, "left")]
    for keep, other, way in sides:
        pairs = zip_longest(_walk(keep, split.feature, way), _walk(other))
        if all(_alike(a, b) for a, b in pairs):
            for a, b in zip(_walk(keep, split.feature, way), _walk(other), strict=True):
                if isinstance(a, _Leaf) and isinstance(b, _Leaf):
                    a.value, a.visits = _common_value(tree.actions, a, b), a.visits + b.visits
            return keep
    return split


def _walk(root: _Node, feature: int | None = None, way: _Way = "left") -> Iterator[_Node]:
    """Go through a subtree in preorder, as it is for those who turn one way at every split on a feature."""
    awaited: list[_Node | None] = [root]
    while awaited:
        node = awaited.pop()
        if isinstance(node, _Split) and node.feature == feature:
            awaited.append(node.left if way == "left" else node.right)
        elif node is not None:
            yield node
            awaited += [node.right, node.left] if isinstance(node, _Split) else []


def _alike(a: _Node | None, b: _Node | None) -> bool:
    """Whether two nodes in the same place ask the same question or act the same."""
    if isinstance(a, _Split) and isinstance(b, _Split):
        return (a.feature, a.threshold) == (b.feature, b.threshold)
    return isinstance(a, _Leaf) and isinstance(b, _Leaf) and a.action == b.action


def _common_value(actions: ActionSpec, a: _Leaf, b: _Leaf) -> np.ndarray:
    """Return one value for two leaves that act the same."""
    more_visited = a.value if a.visits >= b.visits else b.value
    if isinstance(actions, BoxActions) or a.visits + b.visits == 0:
        return more_visited
    chances = actions.probabilities(np.stack([a.value, b.value]))
    parts = chances if isinstance(chances, tuple) else (chances,)
    mean = np.concatenate([np.average(part, axis=0, weights=[a.visits, b.visits]) for part in parts])
    logits = flushed(np.log(np.maximum(mean, SMALLEST_NORMAL)))
    # a mean of probabilities can tie, or order two components otherwise than both of its parts
    return logits if actions.decide(logits[None])[0].tobytes() == a.action else more_visited


def _rebuild(tree: DecisionTree, nodes: list[_Node]) -> DecisionTree:
    """Pack nodes in preorder into the arrays of a tree."""
    n_nodes = len(nodes)
    left, right = np.full(n_nodes, NO_CHILD), np.full(n_nodes, NO_CHILD)
    feature, threshold = np.full(n_nodes, NO_FEATURE), np.full(n_nodes, NO_THRESHOLD)
    value = np.zeros((n_nodes, tree.actions.n_outputs), np.float32)
    visits = np.zeros(n_nodes, np.int64)
    roots: list[int] = []
    for i, node in reversed(list(enumerate(nodes))):
        if isinstance(node, _Split):
            left[i], right[i] = roots.pop(), roots.pop()
            feature[i], threshold[i] = node.feature, node.threshold
            visits[i] = visits[left[i]] + visits[right[i]]
        else:
            value[i], visits[i] = node.value, node.visits
        roots.append(i)
    return replace(
        tree,
        children_left=left,
        children_right=right,
        feature=feature,
        threshold=threshold,
        value=value,
        n_node_samples=None if tree.n_node_samples is None else visits,
    )
