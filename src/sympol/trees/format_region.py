"""A box in words: ``0.1 < pole angle ≤ 0.2 and front is lava``."""

from __future__ import annotations

import numpy as np

from .base import BaseTree
from .boxes import Boxes
from .floats import next_below
from .text import Choice, Interval


def region_words(tree: BaseTree, box: Boxes, space: Boxes) -> str:
    """Say what is true of the observations in one box and not of all in the space; nothing where that is all.

    Args:
        tree: Its features, groups and whole numbers.
        box: One box, not empty.
        space: One box, which holds the other one.
    """
    phrases: list[tuple[int, str]] = []
    narrower = (box.low[0] > space.low[0]) | (box.high[0] < space.high[0])
    for feature in np.flatnonzero(narrower).tolist():
        if feature not in tree.group_of:
            phrases.append((feature, _interval(tree, feature, box, space).words()))
    for group in tree.groups:
        gone = [f for f in group.features if box.high[0, f] < 1 <= space.high[0, f]]
        if gone:
            left = [f for f in group.features if box.high[0, f] >= 1]
            known = (
                Choice(group, is_one=tuple(left)) if len(left) == 1 else Choice(group, is_zero=tuple(gone))
            )
            phrases.append((min(group.features), known.words()))
    return " and ".join(words for _, words in sorted(phrases))


def _interval(tree: BaseTree, feature: int, box: Boxes, space: Boxes) -> Interval:
    low, high = box.low[0, feature], box.high[0, feature]
    whole = feature in tree.integers
    below = float(low) - 1 if whole else float(next_below(low))
    return Interval(
        tree.feature_names[feature],
        above=below if low > space.low[0, feature] else None,
        most=float(high) if high < space.high[0, feature] else None,
    )
