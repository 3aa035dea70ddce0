"""Many changed trees against the one that was changed: successive halving (Jamieson and Talwalkar 2016).

All play a few episodes, the better half of them twice as many, and so on, always the same episodes as the tree itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..trees import DecisionTree
from .scores import Scores
from .sequential_test import looks


def race(
    scores: Scores,
    tree: DecisionTree,
    others: Sequence[DecisionTree],
    *,
    keep: int,
    first: int,
    last: int,
    key: Callable[[float, int], Any] = lambda loss, _: loss,
) -> list[tuple[float, int]]:
    """The best of ``others`` and what they earn less than ``tree``, as pairs of the loss and the position.

    Until at most ``keep`` are left or ``last`` episodes are played. Those come first whose ``key``, of loss and
    position, is least.
    """
    field = [(0.0, i) for i in range(len(others))]
    for number in looks(first, last):
        returns = scores.of_all([tree, *(others[i] for _, i in field)], number, like=tree)
        means = returns.mean(axis=1, dtype=np.float64)
        field = [(float(means[0] - mean), i) for mean, (_, i) in zip(means[1:], field, strict=True)]
        field.sort(key=lambda each: key(*each))
        if len(field) <= keep or number == last:
            break
        field = field[: max(keep, len(field) // 2)]
    return field
