from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional import entmax15
from sympol.functional.entmax import entmoid15
from tests.functional.oracle import entmax15_sorted


@pytest.fixture(autouse=True)
def strict():
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        yield


def sorted_in_float64(logits: np.ndarray) -> np.ndarray:
    """Peters et al. 2019, algorithm 2, in NumPy: independent of JAX and of Newton."""
    z = np.asarray(logits, np.float64) / 2
    z = z - z.max(-1, keepdims=True)
    ordered = -np.sort(-z, -1)
    k = np.arange(1, z.shape[-1] + 1)
    mean = np.cumsum(ordered, -1) / k
    spread = np.cumsum(ordered**2, -1) - k * mean**2
    thresholds = mean - np.sqrt(np.clip((1 - spread) / k, 0, None))
    support = (thresholds <= ordered).sum(-1, keepdims=True)
    return np.maximum(z - np.take_along_axis(thresholds, support - 1, -1), 0) ** 2


def hard_cases(n: int) -> np.ndarray:
    """Rows that need many steps: ties, one ahead of equal others, ramps and clusters at every scale."""
    rng = np.random.default_rng(n)
    rows = [np.zeros((1, n)), np.full((1, n), 1e4), np.full((1, n), -1e4)]
    rows += [rng.normal(size=(200, n)) * s for s in (1e-6, 1e-3, 0.03, 0.3, 1, 3, 10, 1e3)]
    rows += [np.round(rng.normal(size=(200, n)) * 3) / 2]
    rows += [-(np.linspace(0, 1, n)[None] ** rng.uniform(0.02, 20, (400, 1))) * rng.uniform(0, 4, (400, 1))]
    rows += [-np.exp(rng.uniform(-9, 2, (200, n)))]
    behind = np.full((400, n), -1.0) * rng.uniform(0, 2.1, (400, 1))
    behind[:, 0] = 0
    rows += [behind, np.where(rng.random((400, n)) < rng.random((400, 1)), 0, behind)]
    return np.concatenate(rows).astype(np.float32)


@pytest.mark.parametrize("n", [1, 2, 3, 8, 31, 147, 1000])
def test_value_equals_the_sorting_algorithm_in_float64(n):
    logits = hard_cases(n)
    p = np.asarray(jax.jit(entmax15)(logits))
    np.testing.assert_allclose(p, sorted_in_float64(logits), atol=4e-7, rtol=0)
    np.testing.assert_allclose(p.sum(-1, dtype=np.float64), 1, atol=1e-5)


@pytest.mark.parametrize("n", [1, 2, 8, 147])
def test_derivative_equals_autodiff_of_the_sorting_algorithm_in_float64(n):
    rng = np.random.default_rng(0)
    logits, v = (rng.normal(size=(64, n)).astype(np.float32) for _ in range(2))
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        pullback = jax.jit(lambda x, v: jax.vjp(entmax15_sorted, x)[1](v)[0])
        expected = np.asarray(pullback(np.asarray(logits, np.float64), np.asarray(v, np.float64)))
    backward = jax.jit(lambda x, v: jax.vjp(entmax15, x)[1](v)[0])(logits, v)
    np.testing.assert_allclose(backward, expected, atol=2e-6)
    forward = jax.jit(lambda x, v: jax.jvp(entmax15, (x,), (v,))[1])(logits, v)
    np.testing.assert_allclose(forward, expected, atol=2e-6)  # the derivative is symmetric


def test_closed_forms():
    np.testing.assert_allclose(entmax15(jnp.zeros(4)), [0.25] * 4, rtol=1e-6)
    assert entmax15(jnp.array([7.0]))[0] == 1
    assert np.array_equal(entmax15(jnp.array([0.0, 2.0, 0.0])), [0, 1, 0])  # two ahead: all of it
    # two entries: √p is (√(2 − δ²) ± δ)/2 with δ half their difference
    for difference in (0.0, 0.3, 1.0, 1.9):
        delta = difference / 2
        root = (np.sqrt(2 - delta**2) + np.array([delta, -delta])) / 2
        np.testing.assert_allclose(entmax15(jnp.array([difference, 0.0])), root**2, rtol=2e-6)


def test_invariance_axis_and_vmap():
    logits = jnp.asarray(np.random.default_rng(0).normal(size=(3, 5, 4)).astype(np.float32))
    p = entmax15(logits)
    np.testing.assert_allclose(entmax15(logits + 8), p, atol=1e-6)
    np.testing.assert_allclose(
        entmax15(jnp.moveaxis(logits, -1, 0), axis=0), jnp.moveaxis(p, -1, 0), atol=1e-7
    )
    np.testing.assert_allclose(jax.vmap(entmax15)(logits), p, atol=1e-7)
    np.testing.assert_allclose(entmax15(logits[..., ::-1]), p[..., ::-1], atol=1e-6)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="axis must exist in logits of shape \\(2, 3\\), got 2"):
        entmax15(jnp.zeros((2, 3)), axis=2)
    with pytest.raises(ValueError, match="must have an entry along axis -1, got shape \\(2, 0\\)"):
        entmax15(jnp.zeros((2, 0)))


ENDS = np.float32(
    [-3e38, -1e9, -1e3, -2.0001, -2, -1.9999, -0.0, 0, 1e-30, 1.9999, 2, 2.0001, 1e3, 1e9, 3e38]
)
Z = np.concatenate([np.linspace(-2.5, 2.5, 2001, dtype=np.float32), ENDS])


def first_of_two(z: jax.Array) -> jax.Array:
    return entmax15(jnp.stack([z, jnp.zeros_like(z)], axis=-1))[..., 0]


def pairs(z: np.ndarray) -> np.ndarray:
    return np.stack([z, np.zeros_like(z)], axis=-1)


def test_entmoid_is_the_first_of_two_probabilities():
    p = np.asarray(jax.jit(entmoid15)(Z))
    np.testing.assert_allclose(p, jax.jit(first_of_two)(Z), atol=4e-7, rtol=0)
    np.testing.assert_allclose(p, sorted_in_float64(pairs(Z))[:, 0], atol=2e-7, rtol=0)
    assert np.array_equal(p[Z <= -2], np.zeros_like(p[Z <= -2]))
    assert np.array_equal(p[Z >= 2], np.ones_like(p[Z >= 2]))
    assert np.all(np.diff(p[:2001]) >= 0)
    grid = Z[:2000].reshape(5, 8, 50)
    assert np.array_equal(jax.jit(entmoid15)(grid), p[:2000].reshape(5, 8, 50))


def test_the_two_probabilities_of_an_entmoid_sum_to_one():
    np.testing.assert_allclose(jax.jit(entmoid15)(Z) + jax.jit(entmoid15)(-Z), 1, atol=2e-7, rtol=0)
    np.testing.assert_allclose(entmoid15(jnp.float32(0)), 0.5, rtol=1e-7)


def test_derivative_of_the_entmoid():
    """Against differences of the sorting algorithm in float64, and against entmax15's own derivative."""
    slope = np.asarray(jax.jit(jax.vmap(jax.grad(entmoid15)))(Z))
    h = 1e-5
    near = np.abs(Z) < 10  # beyond, float64 cannot tell z from z + h
    right, left = (sorted_in_float64(pairs(Z[near].astype(np.float64) + d))[:, 0] for d in (h, -h))
    np.testing.assert_allclose(slope[near], (right - left) / (2 * h), atol=2e-6, rtol=0)
    theirs = jax.jit(jax.vmap(jax.grad(first_of_two)))(Z)
    np.testing.assert_allclose(slope, theirs, atol=2e-6, rtol=0)
    np.testing.assert_allclose(slope, slope_by_hand(Z), atol=4e-7, rtol=0)


def slope_by_hand(z: np.ndarray) -> np.ndarray:
    """entmax15's symmetric matrix for two entries, s = √p: p' = s₁s₂ / (s₁ + s₂)."""
    s = np.sqrt(sorted_in_float64(pairs(z)))
    return s.prod(-1) / s.sum(-1)


def test_the_entmoid_s_gradient_is_zero_at_its_ends_and_never_nan():
    slope_at = jax.jit(jax.vmap(jax.grad(entmoid15)))
    slope = np.asarray(slope_at(Z))
    assert np.isfinite(slope).all()
    assert not np.any(slope[np.abs(Z) >= 2])
    assert np.all(slope[np.abs(Z) < 1.99] > 0)
    special = np.float32([-np.inf, np.inf, 0])
    np.testing.assert_allclose(jax.jit(entmoid15)(special), [0, 1, 0.5], rtol=1e-7)
    np.testing.assert_allclose(slope_at(special), [0, 0, 2**-1.5], rtol=1e-6)
