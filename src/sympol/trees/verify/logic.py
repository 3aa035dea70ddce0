"""Conditions on numbers: intervals joined by and, or and not.

The same conditions speak of observations, where they are turned into boxes, and of actions, of which each leaf
has only one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, final

import numpy as np

from ..boxes import Boxes
from ..floats import next_above, next_below

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

_MOST_BOXES = 1_000
"""A condition that is more boxes than this is one nobody wrote by hand."""


@final
@dataclass(frozen=True)
class Between:
    """The number at a position is from ``low`` to ``high``, both included, both float32; it is not NaN."""

    position: int
    low: float
    high: float


@final
@dataclass(frozen=True)
class All:
    """All parts hold; without parts, this always does."""

    parts: tuple[Condition, ...] = ()


@final
@dataclass(frozen=True)
class Any:
    """At least one part holds; without parts, this never does."""

    parts: tuple[Condition, ...] = ()


@final
@dataclass(frozen=True)
class Not:
    """The part does not hold. The opposite of a comparison is a comparison: NaN meets neither."""

    part: Condition


Condition: TypeAlias = Between | All | Any | Not
ALWAYS = All()


def satisfied(
    condition: Condition, numbers: Float[np.ndarray, "batch n"], *, negated: bool = False
) -> Bool[np.ndarray, " batch"]:
    """Return of which rows a condition, or its opposite, is true."""
    match condition:
        case Not(part):
            return satisfied(part, numbers, negated=not negated)
        case Between(position, low, high):
            x = numbers[:, position]
            return ((x < low) | (x > high)) if negated else ((low <= x) & (x <= high))
        case All(parts) | Any(parts):
            each = [satisfied(part, numbers, negated=negated) for part in parts]
            join = np.logical_and if isinstance(condition, All) != negated else np.logical_or
            return join.reduce([np.full(len(numbers), join is np.logical_and), *each])


def boxes_of(condition: Condition, start: Boxes, *, negated: bool = False) -> Boxes:
    """Return the boxes, none of them empty, that together are where a condition, or its opposite, is true in ``start``.

    They may overlap.

    Raises:
        ValueError: if there would be too many.
    """
    found = _boxes(condition, start, negated)
    return found[~found.is_empty]


def _boxes(condition: Condition, start: Boxes, negated: bool) -> Boxes:
    match condition:
        case Not(part):
            return _boxes(part, start, not negated)
        case Between(position, low, high):
            return joined(start, [_cut(start, position, *ends) for ends in _ends(low, high, negated)])
        case All(parts) | Any(parts):
            if isinstance(condition, All) == negated:
                return joined(start, [boxes_of(part, start, negated=negated) for part in parts])
            for part in parts:
                start = boxes_of(part, start, negated=negated)
            return start


def _ends(low: float, high: float, negated: bool) -> Iterator[tuple[float, float]]:
    if not negated:
        yield low, high
        return
    if low > -np.inf:
        yield -np.inf, float(next_below(low))
    if high < np.inf:
        yield float(next_above(high)), np.inf


def _cut(boxes: Boxes, position: int, low: float, high: float) -> Boxes:
    lows, highs, nan = boxes.low.copy(), boxes.high.copy(), boxes.nan.copy()
    lows[:, position] = np.maximum(lows[:, position], np.float32(low))
    highs[:, position] = np.minimum(highs[:, position], np.float32(high))
    nan[:, position] = False
    return replace(boxes, low=lows, high=highs, nan=nan)


def joined(like: Boxes, several: Sequence[Boxes]) -> Boxes:
    """Return all boxes of several as one; of the same space as ``like``.

    Raises:
        ValueError: if these are too many.
    """
    if sum(map(len, several)) > _MOST_BOXES:
        raise ValueError(
            f"the condition has more than {_MOST_BOXES:,} cases; split it into several properties"
        )
    return like[:0].joined(several)
