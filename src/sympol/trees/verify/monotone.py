"""Monotonicity: whether an action never falls as one feature rises and all others stay.

Two leaves are against it where an observation of the one becomes one of the other by changing that feature alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..boxes import Boxes
from ..readable import readable
from ..tree import DecisionTree
from .arrivals import Arrivals, acted, numbers
from .terms import Monotone
from .verdict import simplest

if TYPE_CHECKING:
    from jaxtyping import Bool, Float32

_AT_ONCE = 20_000
"""Pairs of boxes that are cut at the same time."""


def pair_against(
    tree: DecisionTree, claim: Monotone, ends: Arrivals
) -> tuple[np.ndarray, list[Float32[np.ndarray, " features"]]]:
    """Return the leaves between which a claim is not true, and two observations that show it, if there are any.

    The second of the two has the greater feature, and all else in common.
    """
    action = _rising(claim) * numbers(tree, ends.leaf)[:, claim.component]
    low, high = ends.boxes.low[:, claim.feature], ends.boxes.high[:, claim.feature]
    first, second = np.nonzero((action[:, None] > action) & (low[:, None] <= high))
    others = _free(ends.boxes, claim.feature)
    meet = _meet(others, first, second)
    first, second = first[meet], second[meet]
    if not len(first):
        return first, []
    common = others[first].intersect(others[second])
    pair = simplest(common)
    x = common.some_observation(pair)
    i, j = first[pair], second[pair]
    x[claim.feature] = readable(float(low[i]), float(min(high[i], high[j])))
    y = x.copy()
    y[claim.feature] = readable(float(max(low[j], x[claim.feature])), float(high[j]))
    return np.unique(ends.leaf[np.concatenate([first, second])]), [x, y]


def is_against(tree: DecisionTree, claim: Monotone, pair: list[Float32[np.ndarray, " features"]]) -> bool:
    """Whether two observations show that a claim is not true."""
    x, y = pair
    same = np.array_equal(np.delete(x, claim.feature), np.delete(y, claim.feature), equal_nan=True)
    before, after = _rising(claim) * acted(tree, pair)[:, claim.component]
    return same and bool(x[claim.feature] < y[claim.feature] and before > after)


def _rising(claim: Monotone) -> int:
    return 1 if claim.increasing else -1


def _free(boxes: Boxes, feature: int) -> Boxes:
    """The boxes with one feature let go."""
    low, high, nan = boxes.low.copy(), boxes.high.copy(), boxes.nan.copy()
    low[:, feature], high[:, feature], nan[:, feature] = -np.inf, np.inf, False
    return replace(boxes, low=low, high=high, nan=nan)


def _meet(boxes: Boxes, first: np.ndarray, second: np.ndarray) -> Bool[np.ndarray, " pairs"]:
    """Whether boxes have something in common, pair by pair."""
    found = [np.zeros(0, bool)]
    for begin in range(0, len(first), _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        found.append(~boxes[first[some]].intersect(boxes[second[some]]).is_empty)
    return np.concatenate(found)
