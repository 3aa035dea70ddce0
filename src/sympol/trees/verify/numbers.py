"""Comparisons with decimal numbers as sets of float32 numbers, without an error of rounding.

A rule says ``x > 0.1`` about the real number 0.1, which is no float32. Which float32 numbers are greater than it
is decided in decimals, never by rounding 0.1 first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal

import numpy as np

from ..floats import flushed, next_above, next_below


def interval(relation: str, number: Decimal) -> tuple[float, float]:
    """Return the lowest and highest float32 x for which ``x relation number``: ``<``, ``<=``, ``>``, ``>=`` or ``=``.

    -inf is less and inf greater than any number. Where there is no such x, the lowest exceeds the highest.
    """
    match relation:
        case "<":
            return -math.inf, _highest(lambda x: x < number, number)
        case "<=":
            return -math.inf, _highest(lambda x: x <= number, number)
        case ">":
            return _lowest(lambda x: x > number, number), math.inf
        case ">=":
            return _lowest(lambda x: x >= number, number), math.inf
        case "=":
            return _lowest(lambda x: x >= number, number), _highest(lambda x: x <= number, number)
    raise ValueError(f"unknown relation {relation!r}")


def _lowest(holds: Callable[[Decimal], bool], number: Decimal) -> float:
    """Return the lowest float32 of those from some one on, near ``number``, for which it holds."""
    x = flushed(float(number))
    while holds(_decimal(below := next_below(x))) and below != x:
        x = below
    while not holds(_decimal(x)):
        x = next_above(x)
    return float(x)


def _highest(holds: Callable[[Decimal], bool], number: Decimal) -> float:
    # copy_negate, for a minus rounds to 28 digits
    return -_lowest(lambda x: holds(x.copy_negate()), number.copy_negate())


def _decimal(x: np.ndarray) -> Decimal:
    return Decimal(float(x))
