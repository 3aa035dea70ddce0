"""Sufficient reasons: the fewest features of an observation that force the action, whatever the others are.

For each leaf with another action, the reason must contain a feature whose value does not lead tnear. So it is a
smallest hitting set, found exactly by branch and bound (a minimum-cardinality sufficient reason in Darwiche and Hirth,
2020).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import final

import numpy as np

from ..base import BaseTree
from .neighborhood import ExplanationFeature, LocalNeighborhood


@final
@dataclass(frozen=True)
class Reason:
    """The features that alone force an action.

    Args:
        features: The features and groups; empty if there is no other action.
        words: Their values in words, such as ``pole angle = 0.1 and front is lava``.
    """

    features: tuple[ExplanationFeature, ...]
    words: str

    @property
    def names(self) -> tuple[str, ...]:
        """The names of features and groups."""
        return tuple(feature.name for feature in self.features)


def smallest_reason(tree: BaseTree, near: LocalNeighborhood) -> Reason:
    """Return the reason with the fewest features; of several, the one whose features come first.

    Args:
        tree: The tree.
        near: The neighbourhood of the observation.
    """
    actions = near.actions.reshape(len(near.leaves), -1)
    other = (actions != actions[near.own]).any(axis=1) & near.reachable
    bits = [sum(1 << int(i) for i in np.flatnonzero(~row)) for row in near.keeps[other]]
    chosen = tuple(near.features[i] for i in smallest_hitting_set(bits))
    return Reason(chosen, " and ".join(feature.words(near.x) for feature in chosen))


def smallest_hitting_set(sets: Iterable[int]) -> tuple[int, ...]:
    """Return the fewest numbers such that each set contains at least one of them.

    Args:
        sets: Each a set of numbers, given by its bits.

    Returns:
        The numbers, in order.

    Raises:
        ValueError: If a set is empty.
    """
    minimal: list[int] = []
    for one in sorted({*sets}, key=lambda one: (one.bit_count(), one)):
        if not one:
            raise ValueError("an empty set cannot be hit")
        if not any(one & other == other for other in minimal):
            minimal.append(one)
    size = _disjoint(minimal)
    while (found := _hit(minimal, size)) is None:
        size += 1
    return tuple(sorted(found))


def _hit(sets: list[int], size: int) -> tuple[int, ...] | None:
    """Return at most ``size`` numbers that hit all sets; None if there are none."""
    # sets of one number leave no choice; they are hit all at once, for there may be thousands
    forced = reduce(or_, (one for one in sets if one.bit_count() == 1), 0)
    if forced:
        found = _hit([one for one in sets if not one & forced], size - forced.bit_count())
        return None if found is None else (*_bits(forced), *found)
    if not sets:
        return () if size >= 0 else None
    if _disjoint(sets) > size:
        return None
    branch = min(sets, key=lambda one: (one.bit_count(), one))
    for i in _bits(branch):
        bit = 1 << i
        found = _hit([one for one in sets if not one & bit], size - 1)
        if found is not None:
            return (i, *found)
        # all solutions with it have been tried: from here on it is not chosen
        sets = [one & ~bit for one in sets]
        if not all(sets):
            return None
    return None


def _disjoint(sets: list[int]) -> int:
    """Return how many sets are disjoint, counted greedily: no fewer numbers hit them all."""
    covered = n = 0
    for one in sorted(sets, key=int.bit_count):
        if not one & covered:
            covered, n = covered | one, n + 1
    return n


def _bits(one: int) -> list[int]:
    return [i for i in range(one.bit_length()) if one >> i & 1]
