"""Sufficient reasons: the smallest part of an observation that forces the action, whatever the rest is.

It must keep the observation out of every leaf with another action: for each such leaf it must contain at least one
value that does not lead there. The smallest part that does is a smallest hitting set, found
exactly, by branch and bound (Darwiche and Hirth 2020 call it a minimum-cardinality sufficient reason).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import final

import numpy as np

from .base import BaseTree
from .explanation_features import LocalNeighborhood, Unit


@final
@dataclass(frozen=True)
class Reason:
    """The features and groups that force an action; without units, there is no other action."""

    units: tuple[Unit, ...]
    words: str
    """``pole angle = 0.1 and front is lava``; empty without units."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of features and groups."""
        return tuple(unit.name for unit in self.units)


def smallest_reason(tree: BaseTree, here: LocalNeighborhood) -> Reason:
    """Return the reason with the fewest units; of several, the one whose units come first."""
    actions = tree.leaf_actions[here.leaves].reshape(len(here.leaves), -1)
    own = actions[np.searchsorted(here.leaves, here.leaf)]
    other = (actions != own).any(axis=1) & here.reachable
    bits = [sum(1 << int(unit) for unit in np.flatnonzero(~row)) for row in here.keeps[other]]
    chosen = tuple(here.units[i] for i in smallest_hitting_set(bits))
    return Reason(chosen, " and ".join(unit.words(here.x) for unit in chosen))


def smallest_hitting_set(sets: Iterable[int]) -> tuple[int, ...]:
    """Return the fewest positions of which each set has at least one.

    Args:
        sets: The sets, each as the bits of an integer.

    Returns:
        The positions, in order.

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
    """Return at most ``size`` positions that hit all sets, or None if there are none."""
    # what hits a set that has nothing else, all of it at once: there may be thousands
    forced = reduce(or_, (one for one in sets if one.bit_count() == 1), 0)
    if forced:
        found = _hit([one for one in sets if not one & forced], size - forced.bit_count())
        return None if found is None else (*_bits(forced), *found)
    if not sets:
        return () if size >= 0 else None
    if _disjoint(sets) > size:
        return None
    branch = min(sets, key=lambda one: (one.bit_count(), one))
    for position in _bits(branch):
        bit = 1 << position
        found = _hit([one for one in sets if not one & bit], size - 1)
        if found is not None:
            return (position, *found)
        # all sets with it were tried: from here on it is not chosen
        sets = [one & ~bit for one in sets]
        if not all(sets):
            return None
    return None


def _disjoint(sets: list[int]) -> int:
    """Return the number of greedily chosen disjoint sets, a lower bound of the positions that hit them all."""
    covered = n = 0
    for one in sorted(sets, key=int.bit_count):
        if not one & covered:
            covered, n = covered | one, n + 1
    return n


def _bits(one: int) -> list[int]:
    return [i for i in range(one.bit_length()) if one >> i & 1]
