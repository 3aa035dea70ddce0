"""Spread is judged beside the values, in any unit, and is the same to training and to stable-baselines3's policy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional.spread import LARGEST_SCALE, RESOLUTION, center_and_scale, moves

RNG = np.random.default_rng(0)
UNIFORM = RNG.uniform(-1, 1, (512, 1))
center = jax.jit(center_and_scale)


def seen(x: np.ndarray) -> tuple[bool, float, float]:
    moving, mean, scale = center(jnp.asarray(x, jnp.float32))
    return bool(moving[0]), float(mean[0]), float(scale[0])


@pytest.mark.parametrize("unit", [1e-35, 1e-30, 1e-12, 1e-7, 1e-6, 1e-3, 1.0, 1e6, 1e12, 1e18])
@pytest.mark.parametrize("offset", [0.0, 3.0, 100.0, 30_000.0])
def test_a_feature_of_any_unit_moves(unit, offset):
    x = np.float32((UNIFORM + offset) * unit)
    moving, mean, scale = seen(x)
    exact = x.astype(np.float64)
    assert moving
    assert abs(mean - exact.mean()) < 0.05 * exact.std()
    np.testing.assert_allclose(scale, 0.5 / exact.std(), rtol=1e-2)


@pytest.mark.parametrize(
    "x",
    [
        np.zeros((512, 1)),
        np.full((512, 1), 1e6),
        np.full((512, 1), 1234567.0),
        np.full((512, 1), -1e18),
        1e6 + 0.03125 + 0.01 * UNIFORM,
        1 + 1e-7 * UNIFORM,
        1e-30 * (1 + 1e-7 * UNIFORM),
    ],
)
def test_what_differs_by_rounding_alone_is_constant(x):
    assert not seen(x)[0]
    x = np.float32(x)
    assert not moves(x.min(), x.max())


def test_the_smallest_spread_has_a_finite_scale():
    x = np.zeros((512, 1), np.float32)
    x[7] = np.finfo(np.float32).smallest_normal
    moving, _, scale = seen(x)
    assert moving
    assert 0 < scale <= LARGEST_SCALE


def test_resolution_is_a_few_neighbours():
    one = np.float32(1)
    near, far = one + np.float32(RESOLUTION), one + np.float32(2 * RESOLUTION)
    assert not moves(one, near)
    assert moves(one, far)
    assert moves(-far, -one)
