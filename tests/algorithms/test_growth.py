"""Growth in eight equal stages, and minibatches that divide."""

from __future__ import annotations

from fractions import Fraction
from math import ceil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.config import MAX_TIMESTEPS
from sympol.algorithms.growth import NUM_STAGES, num_minibatches, stage

traced_stage = jax.jit(stage, static_argnums=(1, 2))


def exact_stage(t: int, total: int) -> int:
    return ceil(Fraction(8 * (t + 1), total + 1)) - 1


def interesting_steps(total: int) -> list[int]:
    near = {total * eighth // 8 + offset for eighth in range(9) for offset in range(-3, 4)}
    rng = np.random.default_rng(total)
    return sorted({t for t in near if 0 <= t < total} | set(rng.integers(total, size=20).tolist()))


@pytest.mark.parametrize(
    "total", [1, 2, 7, 8, 9, 64, 1000, 4096, 99_999, 1_000_000, 2**24 + 1, MAX_TIMESTEPS]
)
def test_stage_is_exact_in_python_and_traced(total):
    steps = interesting_steps(total)
    expected = [exact_stage(t, total) for t in steps]
    assert [stage(t, total, 7) for t in steps] == expected
    assert [int(traced_stage(np.int32(t), total, 7)) for t in steps] == expected
    assert traced_stage(np.int32(0), total, 7).dtype == jnp.int32


def test_stages_are_eight_equal_parts_of_the_training():
    total = 8000
    stages = np.array([stage(t, total, 7) for t in range(total)])
    assert (np.diff(stages) >= 0).all()
    counts = np.bincount(stages)
    assert len(counts) == NUM_STAGES
    assert abs(counts - total / 8).max() <= 1


@pytest.mark.parametrize("most", range(8))
def test_growth_is_capped(most):
    for t in interesting_steps(1000):
        assert stage(t, 1000, most) == min(exact_stage(t, 1000), most)
        assert int(traced_stage(np.int32(t), 1000, most)) == min(exact_stage(t, 1000), most)


@pytest.mark.parametrize("chunk", [1, 7, 16, 48, 60, 64, 100, 512])
@pytest.mark.parametrize("least", [1, 5, 16, 64, 1000])
def test_minibatches_divide_the_chunk_and_are_large_enough(chunk, least):
    n = num_minibatches(chunk, least)
    assert chunk % n == 0
    assert n == 1 or chunk // n >= least
    larger = [m for m in range(n + 1, chunk + 1) if chunk % m == 0 and chunk // m >= least]
    assert not larger
