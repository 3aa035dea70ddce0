"""The number of an interval that is easiest to read: 0, or the fewest digits, and then the nearest to 0."""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, Context, Decimal

from .floats import flushed, number

_DIGITS_OF_FLOAT32 = 9
"""So many significant digits name every float32 number."""


def readable(low: float, high: float) -> float:
    """Return the float32 number from ``low`` to ``high``, float32 both, that is easiest to read.

    NaN where there is none. 0 if it is among them; else the number with the fewest significant decimal digits,
    and of these the one nearest to 0.
    """
    if not low <= high:
        return math.nan
    if low <= 0 <= high:
        return 0.0
    if high < 0:
        return -readable(-high, -low)
    if math.isinf(low):
        return low
    for digits in range(1, _DIGITS_OF_FLOAT32):
        rounded_up = Context(prec=digits, rounding=ROUND_CEILING).create_decimal(Decimal(number(low)))
        candidate = float(flushed(float(rounded_up)))
        if low <= candidate <= high and math.isfinite(candidate):
            return candidate
    return low
