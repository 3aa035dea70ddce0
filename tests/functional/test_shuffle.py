"""A permutation that never sorts the whole."""

from __future__ import annotations

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional.shuffle import Shuffle


@functools.partial(jax.jit, static_argnums=(1, 2))
def all_rows(seed, chunk_size, max_stage, stage):
    shuffle = Shuffle.create(jax.random.key(seed), chunk_size, 1 << max_stage)
    return shuffle(jnp.arange(chunk_size << max_stage, dtype=jnp.int32), stage)


def rows_of(seed: int, chunk_size: int, stage: int, max_stage: int = 7) -> np.ndarray:
    """Where the samples of a rollout of ``2^stage`` chunks lie."""
    return np.asarray(all_rows(np.uint32(seed), chunk_size, max_stage, np.int32(stage)))[
        : chunk_size << stage
    ]


@pytest.mark.parametrize("chunk_size", [1, 2, 7, 16, 48, 60, 128])
def test_shuffle_is_a_bijection_at_every_stage(chunk_size):
    for seed in range(3):
        for k in range(8):
            rows = rows_of(seed, chunk_size, k)
            np.testing.assert_array_equal(np.sort(rows), np.arange(chunk_size << k))


@pytest.mark.parametrize("chunk_size", [48, 64])
@pytest.mark.parametrize("k", [1, 3, 5])
def test_every_minibatch_draws_evenly_from_all_chunks(chunk_size, k):
    """A minibatch of 2^k·m neighbours visits every chunk m times, and its places are all over the chunk."""
    for seed in range(3):
        rows = rows_of(seed, chunk_size, k)
        for batch in rows.reshape(-1, (1 << k) * 8):
            chunk, place = batch // chunk_size, batch % chunk_size
            # for one j all chunks are visited through places that may differ: even up to the jumps
            assert len(np.unique(chunk)) > (1 << k) / 2
            assert np.bincount(chunk, minlength=1 << k).max() <= 8 * 4
            assert place.max() - place.min() > chunk_size / 3


def test_two_epochs_and_two_seeds_differ():
    rows = [rows_of(seed, 64, 2, max_stage=3) for seed in range(4)]
    for i in range(4):
        assert np.mean(rows[i] == np.arange(256)) < 0.05
        for j in range(i):
            assert np.mean(rows[i] == rows[j]) < 0.05


def test_partners_change_between_epochs():
    """Samples that share a minibatch in one epoch mostly do not in the next: no frozen groups."""
    groups = [
        {frozenset(pair) for batch in rows.reshape(-1, 8) for pair in itertools.pairwise(batch)}
        for rows in (rows_of(seed, 64, 3, max_stage=3) for seed in (0, 1))
    ]
    assert len(groups[0] & groups[1]) < 0.1 * len(groups[0])
