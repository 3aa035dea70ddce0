"""Monotonicity: whether an action never falls as one feature rises and all others stay.

Two leaves are against it where an observation of the one becomes one of the other by changing that feature alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes
from ..simplest_float import readable
from .arrivals import Arrivals, acted, numbers
from .terms import Monotone
from .verdict import simplest

if TYPE_CHECKING:
    from jaxtyping import Float32

_AT_ONCE = 50_000
"""Pairs of boxes that are looked at in one go."""


def pair_against(
    tree: BaseTree, claim: Monotone, ends: Arrivals
) -> tuple[np.ndarray, list[Float32[np.ndarray, " features"]]]:
    """Return the leaves between which a claim is not true, and two observations that show it, if there are any.

    The second of the two has the greater feature, and all else in common.
    """
    found = _pairs(tree, claim, ends)
    if not found.simplest:
        return found.leaves, []
    i, j = found.simplest
    boxes, feature = ends.boxes, claim.feature
    x = _common(boxes, feature, np.array([i]), np.array([j])).some_observation()
    low, high = boxes.low[:, feature], boxes.high[:, feature]
    x[feature] = readable(float(low[i]), float(min(high[i], high[j])))
    y = x.copy()
    y[feature] = readable(float(max(low[j], x[feature])), float(high[j]))
    return found.leaves, [x, y]


def is_against(tree: BaseTree, claim: Monotone, pair: list[Float32[np.ndarray, " features"]]) -> bool:
    """Whether two observations show that a claim is not true."""
    x, y = pair
    same = np.array_equal(np.delete(x, claim.feature), np.delete(y, claim.feature), equal_nan=True)
    before, after = _rising(claim) * acted(tree, pair)[:, claim.component]
    return same and bool(x[claim.feature] < y[claim.feature] and before > after)


def _rising(claim: Monotone) -> int:
    return 1 if claim.increasing else -1


class _Pairs(NamedTuple):
    """What pairs of boxes are against a claim."""

    leaves: np.ndarray
    simplest: tuple[int, int] | None


def _pairs(tree: BaseTree, claim: Monotone, ends: Arrivals) -> _Pairs:
    action = _rising(claim) * numbers(tree, ends.leaf)[:, claim.component]
    low, high = ends.boxes.low[:, claim.feature], ends.boxes.high[:, claim.feature]
    involved = np.zeros(len(action), bool)
    best: list[tuple[int, int]] = []
    for rows in np.array_split(np.arange(len(action)), len(action) ** 2 // _AT_ONCE + 1):
        first, second = np.nonzero((action[rows, None] > action) & (low[rows, None] <= high))
        first = rows[first]
        common = _common(ends.boxes, claim.feature, first, second)
        met = ~common.is_empty
        if met.any():
            involved[first[met]] = involved[second[met]] = True
            pick = np.flatnonzero(met)[simplest(common[met])]
            best.append((int(first[pick]), int(second[pick])))
    if not best:
        return _Pairs(np.zeros(0, np.int64), None)
    of_best = _common(ends.boxes, claim.feature, *np.array(best).T)
    return _Pairs(np.unique(ends.leaf[involved]), best[simplest(of_best)])


def _common(boxes: Boxes, feature: int, first: np.ndarray, second: np.ndarray) -> Boxes:
    """What two boxes have in common, pair by pair, whatever the feature is."""
    one, two = boxes[first], boxes[second]
    low, high, nan = np.maximum(one.low, two.low), np.minimum(one.high, two.high), one.nan & two.nan
    low[:, feature], high[:, feature], nan[:, feature] = -np.inf, np.inf, False
    return replace(boxes, low=low, high=high, nan=nan)
