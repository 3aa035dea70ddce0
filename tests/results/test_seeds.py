"""Training, validation, search and test share no seed, and not by luck."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from sympol.algorithms.initialization import PURPOSES, host_seed, purpose_key
from sympol.envs.host_envs import HostEnvs
from sympol.envs.spaces import Features
from sympol.play import episode_seed
from sympol.results.seeds import SEARCH, TRAINING, require_search_seed, require_training_seed

from ..tiny import Chain

SEEDS = (*TRAINING[:25], *TRAINING[-25:], *SEARCH[:25], *SEARCH[-25:])
"""From both ends of both ranges."""


def test_trainings_and_searches_share_no_seed():
    assert TRAINING.stop == SEARCH.start  # so every seed is one of the two
    assert not {*SEEDS[:50]} & {*SEEDS[50:]}
    assert all(seed in TRAINING for seed in SEEDS[:50])
    assert all(seed in SEARCH for seed in SEEDS[50:])


def test_test_episodes_are_odd_and_all_others_even():
    test = {episode_seed(seed, episode) for seed in TRAINING for episode in range(20)}
    others = {
        episode_seed(seed, episode, purpose)
        for seed in SEEDS
        for episode in range(40)
        for purpose in ("validation", "distill")
    }
    assert {seed % 2 for seed in test} == {1}
    assert {seed % 2 for seed in others} == {0}


def test_what_trains_and_validates_on_the_host_is_even_whatever_the_seed():
    envs = [Chain(Box(-1, 1, (2,)), Discrete(2)) for _ in range(8)]
    left = iter(envs)
    host = HostEnvs(lambda: next(left), 8, Features.of(Box(-1, 1, (2,))), Discrete(2))
    given: dict[str, set[int]] = {}
    for seed in SEEDS:
        for purpose in ("train", "validation"):
            host.reset(host_seed(seed, purpose))
            given.setdefault(purpose, set()).update(env.seeds[-1] for env in envs)  # pyright: ignore
    assert {seed % 2 for seeds in given.values() for seed in seeds} == {0}
    assert not given["train"] & given["validation"]


def test_compiled_environments_draw_from_streams_that_never_meet():
    keys = {
        tuple(np.asarray(jax.random.key_data(purpose_key(jnp.uint32(seed), purpose))).tolist())
        for seed in SEEDS
        for purpose in ("init", "train", "validation")
    }
    assert len(keys) == len(SEEDS) * len(PURPOSES)


@pytest.mark.parametrize("seed", [-1, 1000, 2**40, True, 0.5, "0"])
def test_a_seed_of_a_search_is_not_reported(seed):
    with pytest.raises(
        ValueError, match=r"of a training that is reported must be .* from 0 to 999, got .*searches"
    ):
        require_training_seed(seed)
    assert require_training_seed(999) == 999


@pytest.mark.parametrize("seed", [-1, 0, 999, 2**32, False])
def test_a_search_does_not_train_with_a_reported_seed(seed):
    with pytest.raises(ValueError, match=r"of a search must be .* from 1000 to 4294967295, got .* add 1000"):
        require_search_seed(seed)
    assert require_search_seed(1000) == 1000
