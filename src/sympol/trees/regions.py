"""Regions: the observations that can come by a node, as far as the way to it and their space tell.

Left of ``x <= t`` a feature is at most t, and no NaN; right of it, it is greater than t, or NaN. So of each
feature a region knows an interval, open below and closed above, to which NaN belongs where it has no upper
end: NaN goes wherever +inf goes. Of a group it knows which categories are left. The features of a group have
no interval: below 0 and from 1 on, a split does not ask them anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

if TYPE_CHECKING:
    from .tree import DecisionTree

Way: TypeAlias = Literal["left", "right"]


class Region:
    """What is known on the way to a node: `enter` a side of a split, and `leave` it again.

    A region is never empty: one enters only where `way` leaves both sides open. It takes memory in proportion
    to the features and to the splits that were entered.

    Args:
        tree: Its features, their bounds, and its groups.
        bounds: Whether only observations within the bounds count, both ends included. Infinite bounds say
            nothing, and neither do bounds that leave a group no category.
    """

    def __init__(self, tree: DecisionTree, *, bounds: bool) -> None:
        """Begin with the whole space."""
        low, high = tree.feature_low.tolist(), tree.feature_high.tolist()
        if not bounds:
            low, high = [-math.inf] * tree.n_features, [math.inf] * tree.n_features
        # x is known to be NaN or greater than `above`, and, unless that is infinite, at most `most`
        self.above = [math.nextafter(bound, -math.inf) for bound in low]
        self.most = high
        # the categories that are left, a bit each: 1 for the first category of a group, 2 for the second, …
        self.left_of_group = [_possible(group.features, low, high) for group in tree.groups]
        self._bit = {
            feature: (which, 1 << i)
            for which, group in enumerate(tree.groups)
            for i, feature in enumerate(group.features)
        }
        self._before: list[tuple[list[Any], int, Any]] = []

    def way(self, feature: int, threshold: float) -> Way | None:
        """Return the side to which all these observations go, or None where some go to each."""
        if (group_bit := self._bit.get(feature)) is None:
            if threshold <= self.above[feature]:
                return "right"
            return "left" if self.most[feature] <= threshold else None
        if not 0 <= threshold < 1:
            return "right" if threshold < 0 else "left"
        group, bit = group_bit
        if not (left := self.left_of_group[group]) & bit:
            return "left"
        return "right" if left == bit else None

    def enter(self, feature: int, threshold: float, way: Way) -> None:
        """Keep only the observations that go this way at this split."""
        if group_bit := self._bit.get(feature):
            group, bit = group_bit
            left = self.left_of_group[group]
            self._before.append((self.left_of_group, group, left))
            self.left_of_group[group] = left & ~bit if way == "left" else bit
        else:
            ends = self.most if way == "left" else self.above
            self._before.append((ends, feature, ends[feature]))
            ends[feature] = threshold

    @property
    def depth(self) -> int:
        """How many sides were entered and not left."""
        return len(self._before)

    def leave(self) -> None:
        """Forget the side entered last."""
        known, where, before = self._before.pop()
        known[where] = before


def _possible(features: Sequence[int], low: list[float], high: list[float]) -> int:
    """Return the categories, a bit each, whose one-hot is within the bounds; all where none is."""
    everything = (1 << len(features)) - 1
    can_be_one = sum(1 << i for i, feature in enumerate(features) if low[feature] <= 1 <= high[feature])
    # one that cannot be 0 is the category, and two that cannot leave none
    must_be_one = [1 << i for i, feature in enumerate(features) if not low[feature] <= 0 <= high[feature]]
    for bit in must_be_one:
        can_be_one &= bit
    return can_be_one or everything
