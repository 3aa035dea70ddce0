"""The order of the float32 numbers, and the exact place at which a rounded function crosses a threshold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..trees.floats import flushed


def to_rank(x: ArrayLike) -> np.ndarray:
    """Return the ranks of float32 numbers: neighbours differ by one, −0 and +0 are equal.

    Args:
        x: The numbers.

    Returns:
        The ranks, int64.
    """
    bits = np.asarray(x, np.float32).view(np.int32).astype(np.int64)
    return np.where(bits >= 0, bits, -(bits & 0x7FFFFFFF))


def from_rank(rank: np.ndarray) -> np.ndarray:
    """Return the float32 numbers of some ranks.

    Args:
        rank: The ranks.

    Returns:
        The numbers.
    """
    magnitude = np.abs(rank).astype(np.int32).view(np.float32)
    return np.where(rank < 0, -magnitude, magnitude).astype(np.float32)


def largest_below(function: Callable[[np.ndarray], np.ndarray], threshold: np.ndarray) -> np.ndarray:
    """Return for each threshold the largest finite float32 x with ``function(x) <= threshold``.

    The search bisects the 2³² floats, so the answer is exact: ``x <= answer`` and ``function(x) <= threshold`` agree on
    every float32.

    Args:
        function: A function of single numbers that never falls as x grows, rounding included.
        threshold: The thresholds.

    Returns:
        The answers; −inf where not even the lowest finite x qualifies, and zero in place of subnormal numbers.
    """
    extreme = to_rank(np.float32(np.finfo(np.float32).max))
    low = np.full(threshold.shape, -extreme - 1)  # −inf: qualifies by definition
    high = np.full(threshold.shape, extreme + 1)  # +inf: does not
    while np.any(high - low > 1):
        middle = (low + high) // 2
        below = function(from_rank(middle)) <= threshold
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return flushed(from_rank(low))


UNDERFLOW = float(np.finfo(np.float32).smallest_normal) * (1 - 2**-25)
"""The least product that is not zero on a CPU that flushes denormals, which it does after rounding to 24 bits."""


def unscale_thresholds(threshold: np.ndarray, shift: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return raw thresholds that split every x as ``(x − shift) · scale <= threshold`` does in float32.

    Subnormal parameters, observations and intermediate results count as zero.

    Args:
        threshold: Thresholds of scaled features, of any shape.
        shift: The shift of each threshold's feature, of the same shape.
        scale: The scale of each threshold's feature, of the same shape; positive.

    Returns:
        Thresholds of raw features, float32.
    """
    shift, scale = flushed(shift), flushed(scale)

    def scaled(x: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore"):
            product = flushed(flushed(x) - shift).astype(np.float64) * scale  # 48 bits: exact
            return np.where(np.abs(product) < UNDERFLOW, 0, product).astype(np.float32)

    return largest_below(scaled, flushed(threshold))
