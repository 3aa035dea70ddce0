"""Boxes: exact sets of observations, one interval of float32 numbers for each feature.

The observations that reach a leaf are one box, and so are those that meet a condition such as ``x > 0.1 and
front is lava``. Proofs about a tree intersect boxes with boxes.

A box holds for each feature the lowest and the highest float32 number in it, both ends closed, and whether it
contains NaN. Open ends become the next float32, where subnormal numbers do not exist: above 0 comes the smallest
normal number. -0.0 and 0.0 are one number. Features of a group are 0 or 1, features that are whole numbers are
whole and finite; a box is kept as tight as both say, so that it is empty only where an interval is.

`sympol.trees.regions` follows a single path through the tree and back; boxes are arrays, for all leaves at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from .floats import flushed, next_above, simplest_float
from .groups import Group
from .preorder import depths

if TYPE_CHECKING:
    from jaxtyping import Bool, Float32, Int
    from numpy.typing import ArrayLike

    from .base import BaseTree

_LARGEST = np.finfo(np.float32).max
MOST_INTERVALS = 2**25
"""Most intervals in memory, boxes times features: 9 bytes each, and as much again while they are computed."""


@final
@dataclass(frozen=True, eq=False)
class Boxes:
    """An array of boxes over the same features.

    Args:
        low: The lowest number of each feature in each box, [boxes, features].
        high: The highest number, [boxes, features]. A box is empty where it is below ``low`` and ``nan`` is false.
        nan: Whether NaN is in each interval, [boxes, features].
        groups: Which features are one-hot together.
        integers: Which other features are whole numbers.
    """

    low: Float32[np.ndarray, "boxes features"]
    high: Float32[np.ndarray, "boxes features"]
    nan: Bool[np.ndarray, "boxes features"]
    groups: tuple[Group, ...] = ()
    integers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Copy, and tighten the intervals to groups and whole numbers."""
        # + 0 makes -0.0 to 0.0
        low, high, nan = (
            flushed(self.low) + np.float32(0),
            flushed(self.high) + np.float32(0),
            self.nan.copy(),
        )
        for group in self.groups:
            features = list(group.features)
            low[:, features] = np.maximum(low[:, features], 0)
            high[:, features] = np.minimum(high[:, features], 1)
        if whole := [*self.integers, *(feature for group in self.groups for feature in group.features)]:
            low[:, whole] = np.ceil(np.maximum(low[:, whole], -_LARGEST)) + np.float32(0)
            high[:, whole] = np.floor(np.minimum(high[:, whole], _LARGEST)) + np.float32(0)
            nan[:, whole] = False
        for group in self.groups:
            _choose_one(list(group.features), low, high)
        for name, array in (("low", low), ("high", high), ("nan", nan)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.low)

    def __getitem__(self, rows: slice | Sequence[int] | np.ndarray) -> Boxes:
        """Return some of the boxes, selected by a slice, positions, or a mask."""
        return self._tight(self.low[rows], self.high[rows], self.nan[rows])

    def joined(self, others: Sequence[Boxes]) -> Boxes:
        """Return these boxes followed by others over the same features."""
        both = (self, *others)
        low, high, nan = ([getattr(boxes, name) for boxes in both] for name in ("low", "high", "nan"))
        return self._tight(np.concatenate(low), np.concatenate(high), np.concatenate(nan))

    def _tight(self, low: np.ndarray, high: np.ndarray, nan: np.ndarray) -> Boxes:
        """Return boxes known to be tight: tightening them again would take most of the time of a proof."""
        boxes = object.__new__(Boxes)
        for name, value in (("low", low), ("high", high), ("nan", nan)):
            object.__setattr__(boxes, name, value)
        object.__setattr__(boxes, "groups", self.groups)
        object.__setattr__(boxes, "integers", self.integers)
        return boxes

    @property
    def is_empty(self) -> Bool[np.ndarray, " boxes"]:
        """True for each box that contains no observation, [boxes]."""
        return np.any(~(self.low <= self.high) & ~self.nan, axis=1)

    def intersect(self, other: Boxes) -> Boxes:
        """Return the intersection with other boxes, box by box; a single box is intersected with each of the others."""
        return replace(
            self,
            low=np.maximum(self.low, other.low),
            high=np.minimum(self.high, other.high),
            nan=self.nan & other.nan,
        )

    def contains(self, X: ArrayLike) -> Bool[np.ndarray, "boxes batch"]:
        """Return whether each box contains each observation [batch, features], whose groups must be one-hot."""
        x = flushed(X)[None]
        low, high, nan = self.low[:, None], self.high[:, None], self.nan[:, None]
        return np.all(((low <= x) & (x <= high)) | (nan & np.isnan(x)), axis=2)

    def some_observation(self, box: int = 0) -> Float32[np.ndarray, " features"]:
        """Return an observation [features] in a box: near zero, in few digits, one-hot and whole where it must be.

        Raises:
            ValueError: If the box is empty.
        """
        if self.is_empty[box]:
            raise ValueError("the box is empty: there is no observation in it")
        low, high = self.low[box], self.high[box]
        x = np.array(
            [simplest_float(a, b) for a, b in zip(low.tolist(), high.tolist(), strict=True)], np.float32
        )
        x[list(self.integers)] = np.clip(0, low, high)[list(self.integers)]
        for group in self.groups:
            features = list(group.features)
            x[features] = np.eye(len(features))[np.argmax(high[features])]
        return x


def space(tree: BaseTree, *, bounds: bool) -> Boxes:
    """Return the whole observation space of a tree as one box.

    Args:
        tree: The tree.
        bounds: Whether only observations within the bounds count, both ends included and NaN excluded. Bounds
            that leave a group no category do not restrict it, as in `sympol.trees.prune`.

    Returns:
        A single box.

    Raises:
        ValueError: If the boxes of the tree would not fit into memory.
    """
    check_size(tree.n_nodes, tree.n_features)
    shape = (1, tree.n_features)
    everything = Boxes(
        np.full(shape, -np.inf, np.float32),
        np.full(shape, np.inf, np.float32),
        np.full(shape, True),
        tree.groups,
        tree.integers,
    )
    if not bounds:
        return everything
    low, high = tree.feature_low[None], tree.feature_high[None]
    within = everything.intersect(Boxes(low, high, np.full(shape, False)))
    low, high = within.low.copy(), within.high.copy()
    for group in tree.groups:
        features = list(group.features)
        if (low[:, features] > high[:, features]).any():
            low[:, features], high[:, features] = 0, 1
    return replace(within, low=low, high=high)


def check_size(n_boxes: int, n_features: int) -> None:
    """Raise ValueError if this many boxes over this many features would not fit into memory."""
    if n_boxes * n_features > MOST_INTERVALS:
        raise ValueError(
            f"reasoning about the tree would take {n_boxes:,} boxes of {n_features:,} features each, more than fits "
            "into memory; prune the tree, or ask under a condition that concerns less of it"
        )


def node_boxes(tree: BaseTree, *, bounds: bool) -> Boxes:
    """Return the observations that reach each node: box i belongs to node i and is empty if it cannot be reached."""
    start = space(tree, bounds=bounds)
    low, high, nan = (np.repeat(array, tree.n_nodes, axis=0) for array in (start.low, start.high, start.nan))
    depth = depths(tree.children_left, tree.children_right)
    for level in range(int(depth.max())):
        at = np.flatnonzero((depth == level) & ~tree.is_leaf)
        left, right, feature = tree.children_left[at], tree.children_right[at], tree.feature[at]
        for array in (low, high, nan):
            array[left] = array[right] = array[at]
        high[left, feature] = np.minimum(high[left, feature], tree.threshold[at])
        nan[left, feature] = False
        low[right, feature] = np.maximum(low[right, feature], next_above(tree.threshold[at]))
    return replace(start, low=low, high=high, nan=nan)


def leaf_boxes(tree: BaseTree, *, bounds: bool) -> Boxes:
    """Return the observations that reach each leaf, in the order of ``np.flatnonzero(tree.is_leaf)``."""
    return node_boxes(tree, bounds=bounds)[tree.is_leaf]


def unreachable_leaves(tree: BaseTree, *, bounds: bool = True) -> Int[np.ndarray, " leaves"]:
    """Return the leaves that no observation reaches.

    Args:
        tree: The tree.
        bounds: Whether only observations within the bounds of the space count.

    Returns:
        Numbers of the leaves that no observation reaches.
    """
    leaves = np.flatnonzero(tree.is_leaf)
    return leaves[leaf_boxes(tree, bounds=bounds).is_empty]


def _choose_one(features: list[int], low: np.ndarray, high: np.ndarray) -> None:
    """Tighten the intervals of a group, in place, to those with exactly one 1."""
    is_one = low[:, features] >= 1
    others_are = (is_one.sum(axis=1, keepdims=True) - is_one) > 0
    high[:, features] = np.where(others_are, np.minimum(high[:, features], 0), high[:, features])
    can_be_one = high[:, features] >= 1
    last = np.flatnonzero(can_be_one.sum(axis=1) <= 1)
    first = np.array(features)[can_be_one[last].argmax(axis=1)]
    # the only one left is it; where none is left, this makes the first one's interval empty
    low[last, first] = np.maximum(low[last, first], 1)
