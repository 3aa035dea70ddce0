"""float32 numbers as the training program sees them, and how numbers and names are written.

XLA on the CPU treats subnormal numbers as zero; NumPy, Python and C do not. So that a tree decides in all of
them what it decided in training, every number is flushed once, where it enters.
"""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, Context, Decimal
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float32
    from numpy.typing import ArrayLike

SMALLEST_NORMAL = float(np.finfo(np.float32).smallest_normal)
LARGEST_SUBNORMAL = float(np.nextafter(np.float32(SMALLEST_NORMAL), np.float32(0)))

_DIGITS_OF_FLOAT32 = 9
"""Significant digits that identify every float32 number."""


def flushed(x: ArrayLike) -> Float32[np.ndarray, "*shape"]:
    """Copy to float32 (round to nearest, overflow to infinity) with subnormals made zero, their sign kept."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        rounded = np.array(x, dtype=np.float32)
    # multiplying by zero, not assigning it, keeps the sign as the hardware does
    np.multiply(rounded, np.float32(0), out=rounded, where=np.abs(rounded) < SMALLEST_NORMAL)
    return rounded


def observation_batch(X: ArrayLike, n_features: int) -> tuple[Float32[np.ndarray, "batch features"], bool]:
    """Return observations as a flushed batch, and whether there was only one.

    Args:
        X: One observation [features], or many [batch, features]. An empty list is an empty batch.
        n_features: The number of features of an observation.

    Returns:
        The batch in float32, [batch, features], and whether X had no batch axis.

    Raises:
        ValueError: If X has another shape.
        TypeError: If X does not hold real numbers.
    """
    raw = np.asarray(X)
    if raw.shape == (0,) and n_features:
        raw = raw.reshape(0, n_features)
    if raw.dtype.kind not in "fiub":
        raise TypeError(f"an observation holds real numbers, got an array of {raw.dtype}")
    if raw.ndim not in (1, 2) or raw.shape[-1] != n_features:
        expected = f"[{n_features}] or [batch, {n_features}]"
        raise ValueError(f"expected observations of shape {expected}, got {list(raw.shape)}")
    return flushed(np.atleast_2d(raw)), raw.ndim == 1


def next_above(x: ArrayLike) -> Float32[np.ndarray, "*shape"]:
    """Return the next flushed float32 above each: above 0 comes the smallest normal number, above -it comes 0."""
    with np.errstate(over="ignore", under="ignore"):
        above = np.nextafter(flushed(x), np.float32(np.inf))
    return np.where(np.abs(above) < SMALLEST_NORMAL, np.where(above > 0, SMALLEST_NORMAL, 0), above).astype(
        np.float32
    )


def next_below(x: ArrayLike) -> Float32[np.ndarray, "*shape"]:
    """Return the next flushed float32 below each."""
    return -next_above(-flushed(x))


def unflushed_threshold(threshold: float) -> float:
    """Return the t for which ``x <= t`` on a raw float32 x equals ``flushed(x) <= threshold``.

    Only zero needs another number: positive subnormals count as zero, so they are still on its left.
    """
    return LARGEST_SUBNORMAL if threshold == 0 else float(threshold)


def double_threshold(threshold: float) -> float:
    """Return the largest T for which ``x <= T`` on any double x equals ``flushed(x) <= threshold``.

    Rounding is monotone, so it can be done once, to the threshold: T is the middle between the threshold and the
    next float32, or, where the middle is rounded up (to even), the double before it. T itself rounds to the
    threshold (to the largest subnormal number where that is 0), so a float32 x may be compared with T rounded.
    """
    at = np.float32(unflushed_threshold(threshold))
    with np.errstate(over="ignore", under="ignore"):
        above = np.nextafter(at, np.float32(np.inf))
        # beyond the largest float32, rounding behaves as if there were a next one
        middle = (float(at) + (float(above) if np.isfinite(above) else 2.0**128)) / 2
        return middle if np.float32(middle) == at else math.nextafter(middle, -math.inf)


def shortest(x: float) -> float:
    """Return the number with the fewest decimal digits that is x once rounded to float32."""
    exact = np.float32(x)
    short = float(str(exact))
    # a decimal near the middle of two float32 may land on the other one when it is read through a double
    return short if np.float32(short).tobytes() == exact.tobytes() else float(exact)


def number(x: float, digits: int | None = None) -> str:
    """Write x in the fewest digits that give the same float32 back, or in ``digits`` significant ones."""
    if digits is not None:
        return f"{float(x):.{digits}g}"
    return repr(shortest(x)).removesuffix(".0")


def simplest_float(low: float, high: float) -> float:
    """Return the float32 number from ``low`` to ``high`` that is easiest to read.

    This is 0 if the interval contains it, else the number with the fewest significant decimal digits, and of these
    the one nearest to 0. NaN if the interval is empty.
    """
    if not low <= high:
        return math.nan
    if low <= 0 <= high:
        return 0.0
    if high < 0:
        return -simplest_float(-high, -low)
    if math.isinf(low):
        return low
    for digits in range(1, _DIGITS_OF_FLOAT32):
        rounded_up = Context(prec=digits, rounding=ROUND_CEILING).create_decimal(Decimal(number(low)))
        candidate = float(flushed(float(rounded_up)))
        if low <= candidate <= high and math.isfinite(candidate):
            return candidate
    return low


def brief(what: object, most: int = 80) -> str:
    """Return the ``repr`` of an object, cut off after ``most`` characters."""
    # of a text no more is escaped than is shown
    shown = repr(what[:most]) if isinstance(what, str) else repr(what)
    cut = isinstance(what, str) and len(what) > most
    return f"{shown[: most - 3]}..." if cut or len(shown) > most else shown


def printable(name: str) -> str:
    """Write a name on one line: line breaks, control and direction marks become escapes such as ``\\n``."""
    if name.isprintable():
        return name
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in name)
