"""Thresholds in raw units split every float32 as the scaled ones do in the compiled program."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional.float32_order import from_rank, largest_below, to_rank, unscale_thresholds
from sympol.trees.floats import flushed

INF = np.float32(np.inf)
LARGEST = np.finfo(np.float32).max
TINY = np.finfo(np.float32).tiny
SPECIAL = np.float32(
    [0, -0.0, 1e-45, -1e-45, 1e-39, -1e-39, TINY, -TINY, LARGEST, -LARGEST, INF, -INF, np.nan]
)


@jax.jit
def scaled_goes_left(x, shift, scale, threshold):
    """As the program decides: the normaliser's arithmetic, then the comparison, denormals as zero."""
    return ((x - shift) * scale) <= threshold


def every_float_near(x: np.ndarray, reach: int) -> np.ndarray:
    rank = to_rank(x)[None] + np.arange(-reach, reach + 1)[:, None]
    return from_rank(rank)


def cases(kind: str, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thresholds, shifts and scales that are ordinary, or far apart in size, or powers of two, or tiny."""
    rng = np.random.default_rng(["ordinary", "wild", "power", "tiny"].index(kind))
    normal = lambda: rng.normal(size=n).astype(np.float32)  # noqa: E731
    match kind:
        case "ordinary":
            return normal(), normal(), np.exp(normal())
        case "wild":
            size = np.float32(10) ** rng.integers(-6, 7, size=(2, n)).astype(np.float32)
            return normal(), normal() * size[0], size[1] * np.exp(normal())
        case "power":
            return np.round(normal() * 4) / 4, np.round(normal()), np.float32(2) ** np.round(2 * normal())
        case _:
            small = rng.choice(SPECIAL[:8], size=(2, n))
            return small[0], small[1] * rng.integers(0, 2, n).astype(np.float32), np.exp(normal())


@pytest.mark.parametrize("kind", ["ordinary", "wild", "power", "tiny"])
def test_raw_thresholds_split_as_scaled_ones_do(kind):
    """A million float32 for each kind: all the neighbours of each threshold, special ones, random ones."""
    threshold, shift, scale = (a.astype(np.float32) for a in cases(kind, 1000))
    raw = unscale_thresholds(threshold, shift, scale)
    assert raw.dtype == np.float32
    rng = np.random.default_rng(7)
    x = np.concatenate(
        [
            every_float_near(raw, 500),
            np.broadcast_to(SPECIAL[:, None], (len(SPECIAL), 1000)),
            raw + rng.normal(size=(100, 1000)).astype(np.float32) / scale,
            rng.integers(0, 2**32, (100, 1000), dtype=np.uint32).view(np.float32),
        ]
    ).astype(np.float32)
    expected = np.asarray(scaled_goes_left(x, shift[None], scale[None], threshold[None]))
    np.testing.assert_array_equal(flushed(x) <= raw, expected)


def test_thresholds_that_nothing_or_everything_passes():
    one, zero = np.float32([1]), np.float32([0])
    assert unscale_thresholds(np.float32([3e38]), zero, np.float32([0.1])) == LARGEST
    assert unscale_thresholds(np.float32([-3e38]), zero, np.float32([0.1])) == -INF
    assert unscale_thresholds(np.float32([0.5]), zero, one) == np.float32(0.5)


def test_identity_scaling_changes_no_threshold():
    t = np.random.default_rng(0).normal(size=1000).astype(np.float32)
    np.testing.assert_array_equal(unscale_thresholds(t, np.zeros_like(t), np.ones_like(t)), t)


def test_ranks_round_trip_and_count_floats():
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 2**32, 1_000_000, dtype=np.uint32)
    x = bits.view(np.float32)
    x = x[~np.isnan(x)]
    np.testing.assert_array_equal(from_rank(to_rank(x)), x)  # equal, and so −0 may come back as 0
    neighbours = np.nextafter(x[np.isfinite(x)], INF)
    np.testing.assert_array_equal(to_rank(neighbours) - to_rank(x[np.isfinite(x)]), 1)
    np.testing.assert_array_equal(np.argsort(to_rank(x), kind="stable"), np.argsort(x, kind="stable"))
    assert to_rank(np.float32(0)) == to_rank(np.float32(-0.0)) == 0


def test_largest_below_of_a_step_function():
    """A function with plateaus: the answer is the last float of the plateau."""
    threshold = np.float32([0, 1, 2])
    answer = largest_below(lambda x: np.floor(x), threshold)
    np.testing.assert_array_equal(answer, np.nextafter(np.float32([1, 2, 3]), np.float32(0)))
    assert (jnp.floor(answer) <= threshold).all()
