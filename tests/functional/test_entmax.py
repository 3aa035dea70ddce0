from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional import entmax15
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
