"""A small tree inside a complete one, as it is trained: nodes outside the shape are closed.

A closed node sends everything one way: all its thresholds are `MASKED`, or minus that, a number that no feature
reaches and no optimiser moves; and the slope of the surrogate is 0 there, so that nothing is learnt. What is trained
stays one compiled program, whatever the shape. Only NaN and infinities would go the other way: for callers that
reads the tree, closed nodes are not there (`extract_unmasked`).

Every tree that pruning makes of a complete one lies in it, as all it ever does is to put a side in the place of its
split.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32

from ..policies.extract import extract_tree
from ..policies.tree import Tree
from ..trees import DecisionTree
from ..trees.preorder import complete_order
from ..trees.prune import select_nodes

MASKED = float(np.finfo(np.float32).max)
"""The largest float32; the division by a temperature may make infinity of it, which is as good."""


def extract_unmasked(actor: Tree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """`extract_tree`, without the closed nodes."""
    thresholds = np.asarray(actor.thresholds)
    closed = (thresholds == -MASKED).all(axis=1).astype(int) - (thresholds == MASKED).all(axis=1)
    bare = np.where(closed[:, None] == 0, thresholds, 0)
    full = extract_tree(eqx.tree_at(lambda a: a.thresholds, actor, bare), shift, scale, **metadata)
    way = np.append(closed, np.zeros(len(closed) + 1, int))[complete_order(len(closed))]
    left, right = full.children_left.copy(), full.children_right.copy()
    in_place = np.arange(full.n_nodes)
    for node in np.flatnonzero(~full.is_leaf)[::-1]:
        left[node], right[node] = in_place[left[node]], in_place[right[node]]
        if way[node]:  # -1 to the left, 1 to the right
            in_place[node] = left[node] if way[node] < 0 else right[node]
    return select_nodes(full, left, right, int(in_place[0]))


def mask_nodes(
    actor: Tree, shift: np.ndarray, scale: np.ndarray, small: DecisionTree, spare: int = 0
) -> Tree:
    """The complete tree in the shape of a small one that was pruned out of it, and with its answers.

    ``spare`` splits more stay open, where there is room below the leaves of the small tree; both their sides answer
    alike at first, and training can make use of them.

    Raises:
        ValueError: the tree was not made of this one.
    """
    full = extract_tree(actor, shift, scale, actions=small.actions)
    inner = np.argsort(complete_order(len(actor.thresholds)))[: len(actor.thresholds)]
    shape = _Shape(small, full.feature[inner], full.threshold[inner])
    shape.lay(0, 0)
    for _ in range(spare):
        shape.open_one()
    values = np.array(actor.leaf_values)
    for above, answer in shape.ends.items():
        first, last = _leaves_below(above, len(inner))
        alike = (values[first:last] == small.leaf_outputs[answer]).all(axis=1)
        leaf = first + int(np.argmax(alike))  # where none is alike, the first
        values[leaf] = small.leaf_outputs[answer]
        shape.close_between(above, leaf + len(inner))
    way, thresholds = shape.way[:, None], np.asarray(actor.thresholds)
    thresholds = np.where(way < 0, np.float32(MASKED), np.where(way > 0, np.float32(-MASKED), thresholds))
    made = jnp.asarray(thresholds), jnp.asarray(values)
    return eqx.tree_at(lambda a: (a.thresholds, a.leaf_values), actor, made)


class _Shape:
    """Where a small tree lies in a complete one, whose nodes are counted level by level."""

    def __init__(
        self,
        small: DecisionTree,
        feature: Int32[np.ndarray, " splits"],
        threshold: Float32[np.ndarray, " splits"],
    ) -> None:
        self.small = small
        self.way = np.zeros(len(feature), int)
        """Which nodes are closed: -1 to the left, 1 to the right."""
        self.ends: dict[int, int] = {}
        """Nodes below which only one leaf is left, and the small tree's leaf that answers there."""
        self._asking: dict[tuple[int, float], list[int]] = {}
        for node, question in enumerate(zip(feature.tolist(), threshold.tolist(), strict=True)):
            self._asking.setdefault(question, []).append(node)
        self._found: dict[tuple[int, int], int | None] = {}

    def lay(self, node: int, above: int) -> None:
        """Put the small tree's subtree of ``node`` where the complete one's of ``above`` is."""
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
        if at < len(self.way):
            answer = self.ends.pop(at)
            self.ends[2 * at + 1] = self.ends[2 * at + 2] = answer

    def close_between(self, above: int, node: int) -> None:
        """Close the nodes from ``above`` on that lead to ``node``."""
        while node != above:
            parent = (node - 1) // 2
            self.way[parent] = -1 if node == 2 * parent + 1 else 1
            node = parent

    def _place(self, node: int, above: int) -> int | None:
        """The node of the complete tree that asks as ``node`` does, below which all that is below that lies, too."""
        if self.small.is_leaf[node]:
            return above
        if (node, above) not in self._found:
            self._found[node, above] = next(self._places(node, above), None)
        return self._found[node, above]

    def _places(self, node: int, above: int) -> Iterator[int]:
        small = self.small
        left, right = int(small.children_left[node]), int(small.children_right[node])
        for at in self._asking.get((int(small.feature[node]), float(small.threshold[node])), []):
            sides = ((left, 2 * at + 1), (right, 2 * at + 2))
            if _is_below(at, above) and all(self._place(*side) is not None for side in sides):
                yield at


def _is_below(node: int, above: int) -> bool:
    while node > above:
        node = (node - 1) // 2
    return node == above


def _leaves_below(node: int, n_inner: int) -> tuple[int, int]:
    """The first leaf below a node of a complete tree, and the one behind the last, counted from 0."""
    first = last = node
    while first < n_inner:
        first, last = 2 * first + 1, 2 * last + 2
    return first - n_inner, last - n_inner + 1
