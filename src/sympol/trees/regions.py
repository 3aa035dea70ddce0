"""Regions: the observations that can reach a node, as far as the path to it and the space determine them.

Left of ``x <= t`` a feature is at most t and not NaN; right of it, it is greater than t, or NaN. A region holds
for each feature an interval, open below and closed above, which contains NaN if it has no upper end: NaN goes
wherever +inf goes. For a group it holds the categories that are left. Features of a group have no interval: a
threshold below 0, or 1 and above, does not distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from .base import BaseTree

Way: TypeAlias = Literal["left", "right"]


class Region:
    """The observations on the path to a node: `enter` a side of a split, and `leave` it again.

    A region is never empty: one enters only where `way` leaves both sides open. It takes memory in proportion
    to the features and to the splits that were entered.

    Args:
        tree: The tree whose features, bounds and groups count.
        bounds: Whether only observations within the bounds count, both ends included. Infinite bounds restrict
            nothing, nor do bounds that leave a group no category.
    """

    def __init__(self, tree: BaseTree, *, bounds: bool) -> None:
        """Start with the whole space."""
        low, high = tree.feature_low.tolist(), tree.feature_high.tolist()
        if not bounds:
            low, high = [-math.inf] * tree.n_features, [math.inf] * tree.n_features
        # x is known to be NaN or greater than `above`, and, unless that is infinite, at most `most`
        self.above = [math.nextafter(bound, -math.inf) for bound in low]
        self.most = high
        # of each group which features can be the 1, how many these are, and which one it is, once that was said
        self.can_be_one = [False] * tree.n_features
        self.n_possible = [0] * len(tree.groups)
        self.chosen: list[int | None] = [None] * len(tree.groups)
        self._group_of: dict[int, int] = {}
        for which, group in enumerate(tree.groups):
            self._group_of |= dict.fromkeys(group.features, which)
            possible = _possible(group.features, low, high)
            self.n_possible[which] = len(possible)
            for feature in possible:
                self.can_be_one[feature] = True
        self._entered: list[tuple[int, Way, float]] = []

    def way(self, feature: int, threshold: float) -> Way | None:
        """Return the side to which all these observations go, or None if some go to each."""
        if (group := self._group_of.get(feature)) is None:
            if threshold <= self.above[feature]:
                return "right"
            return "left" if self.most[feature] <= threshold else None
        if not 0 <= threshold < 1:
            return "right" if threshold < 0 else "left"
        if (chosen := self.chosen[group]) is not None:
            return "right" if chosen == feature else "left"
        if not self.can_be_one[feature]:
            return "left"
        return "right" if self.n_possible[group] == 1 else None

    def enter(self, feature: int, threshold: float, way: Way) -> None:
        """Restrict the region to the observations that go this way at a split that separates them."""
        ends = self.most if way == "left" else self.above
        self._entered.append((feature, way, ends[feature]))
        if (group := self._group_of.get(feature)) is None:
            ends[feature] = threshold
        elif way == "right":
            self.chosen[group] = feature
        else:
            self.can_be_one[feature] = False
            self.n_possible[group] -= 1

    @property
    def depth(self) -> int:
        """The number of sides entered and not left."""
        return len(self._entered)

    def leave(self) -> None:
        """Undo the last `enter`."""
        feature, way, end = self._entered.pop()
        (self.most if way == "left" else self.above)[feature] = end
        if (group := self._group_of.get(feature)) is not None and way == "right":
            self.chosen[group] = None
        elif group is not None:
            self.can_be_one[feature] = True
            self.n_possible[group] += 1


def _possible(features: Sequence[int], low: list[float], high: list[float]) -> Sequence[int]:
    """Return the features that can be the 1 of their group within the bounds; all of them where none can."""
    # one that cannot be 0 is the 1, and two that cannot leave none
    not_zero = [feature for feature in features if not low[feature] <= 0 <= high[feature]]
    candidates = [f for f in features if low[f] <= 1 <= high[f] and all(f == other for other in not_zero[:2])]
    return candidates or features
