"""One program, compiled once, whatever the stage, the seed and the numbers; the same bits wherever it is cut."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol.algorithms.trainer as trainer_module
from sympol.algorithms.config import Config, Hyperparameters, applies
from sympol.algorithms.initialization import purpose_key
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import Trainer
from sympol.algorithms.work import stops
from sympol.envs.classic.cartpole import CartPole
from tests.algorithms.programs import CARTPOLE, CONFIG, segment_of

COMPILED = "/jax/core/compile/backend_compile_duration"


class Compilations:
    """The names of what is compiled while this is entered (what comes from the disk counts too)."""

    def __enter__(self) -> list[str]:
        self.names: list[str] = []
        jax.monitoring.register_event_duration_secs_listener(self._listen)
        return self.names

    def __exit__(self, *error: object) -> None:
        jax.monitoring.unregister_event_duration_listener(self._listen)

    def _listen(self, event: str, seconds: float, **labels: Any) -> None:
        if event == COMPILED:
            self.names.append(str(labels.get("fun_name")))


def train(config: Config, seed: int, cuts: list[int]) -> TrainState:
    trainer, state = Trainer(CARTPOLE, config, seed), None
    for stop in cuts:
        state = trainer.advance(state, stop)
    assert state is not None
    return state


def assert_same_bits(a: Any, b: Any) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


def test_one_compilation_a_run_though_the_rollout_grows_128_fold():
    trainer_module._known_program.cache_clear()
    config = CONFIG
    with Compilations() as names:
        state = train(config, 0, stops(config))
    assert names == ["jit(segment)"]
    assert int(state.timestep) >= config.total_timesteps
    # the eight stages: as many rollouts of each size as fit into an eighth of the training
    assert config.max_stage == 7
    assert int(state.iteration) == sum(128 // 2**k for k in range(8))

    with Compilations() as names:
        train(config, 1, stops(config))
        train(dataclasses.replace(config, gamma=0.9, learning_rate_critic=0.1, clip_eps=0.1), 0, [4000])
    assert names == []


def test_every_traced_number_is_traced():
    mine = [name for name in Hyperparameters._fields if applies(name, "ppo", "tree")]
    other = {name: getattr(CONFIG, name) / 2 + 0.25 for name in mine}
    assert dataclasses.replace(CONFIG, **other).static() == CONFIG.static()


def test_same_seed_same_bits():
    assert_same_bits(train(CONFIG, 5, [9000]), train(CONFIG, 5, [9000]))


def test_cutting_segments_elsewhere_changes_nothing():
    """But what was seen of it: the validations, and the episodes reported since the last cut."""
    many, few = train(CONFIG, 5, [1, 33, 500, 4096, 5000, 9000]), train(CONFIG, 5, [9000])
    for name in ("networks", "opt_state", "normalizer", "env_state", "observation", "key", "timestep"):
        assert_same_bits(getattr(many, name), getattr(few, name))
    assert_same_bits(many.metrics, few.metrics)
    assert int(many.iteration) == int(few.iteration)
    assert float(many.validation.last_return) == float(few.validation.last_return)


def test_a_state_through_numpy_goes_on_to_the_same_bits():
    """What a checkpoint does: every leaf to the disk and back."""
    trainer = Trainer(CARTPOLE, CONFIG, 5)
    middle = trainer.advance(None, 4096)
    saved = jax.tree.map(lambda a: np.array(a), middle)
    del middle
    again = Trainer(CARTPOLE, CONFIG, 5)
    assert jax.tree.map(np.shape, again.template()) == jax.tree.map(np.shape, saved)
    assert_same_bits(again.advance(saved, 9000), train(CONFIG, 5, [4096, 9000]))


def test_different_seeds_begin_with_different_trees():
    trees = [train(CONFIG, seed, [0]).networks for seed in range(5)]
    for i in range(5):
        for j in range(i):
            for a, b in zip(jax.tree.leaves(trees[i].actor), jax.tree.leaves(trees[j].actor), strict=True):
                assert not np.any(a == b)
            assert not np.any(trees[i].critic.weights[0] == trees[j].critic.weights[0])


def test_no_two_purposes_or_seeds_share_a_key():
    data = [
        tuple(jax.random.key_data(purpose_key(jnp.uint32(seed), purpose)).tolist())
        for seed in range(50)
        for purpose in ("init", "train", "validation")
    ]
    assert len(set(data)) == len(data)


@pytest.mark.slow
def test_mapped_over_seeds_and_numbers_it_is_the_same_training():
    """Three trainings in one program, across the first doubling of the rollout."""
    segment, empty = segment_of(CARTPOLE, CONFIG)
    stop = 5 * 32
    changes = [{}, {"learning_rate_leaf_values": 0.05, "gamma": 0.9}, {"weight_decay": 0.0, "clip_eps": 0.05}]
    hypers = [dataclasses.replace(CONFIG, **change).hyperparameters() for change in changes]
    seeds = np.uint32([0, 1, 1])
    stacked = jax.tree.map(lambda *numbers: np.stack(numbers), *hypers)
    together = jax.jit(jax.vmap(segment, in_axes=(0, 0, None, None, None)))
    with Compilations() as names:
        mapped = together(stacked, seeds, empty, np.bool_(True), np.int32(stop))
    assert len(names) == 1
    for i, hyper in enumerate(hypers):
        alone = segment(hyper, seeds[i], empty, np.bool_(True), np.int32(stop))
        jax.tree.map(
            lambda a, b, i=i: np.testing.assert_allclose(a[i], b, rtol=1e-3, atol=1e-5),
            (
                mapped.networks,
                mapped.normalizer,
                mapped.metrics,
                mapped.timestep,
                mapped.validation.last_return,
            ),
            (alone.networks, alone.normalizer, alone.metrics, alone.timestep, alone.validation.last_return),
        )
    leaves = mapped.networks.actor.leaf_values
    assert not np.any(leaves[0] == leaves[1])
    assert not np.any(leaves[1] == leaves[2])


def test_stops_are_evenly_spaced_and_end_at_the_end():
    assert stops(Config(total_timesteps=1000, num_envs=1, num_evals=4)) == [250, 500, 750, 1000]
    assert stops(Config(total_timesteps=1000, num_envs=1, num_evals=3)) == [334, 667, 1000]
    assert stops(Config(total_timesteps=20, num_envs=1, num_evals=10_000)) == list(range(1, 21))


class OwnEnv:
    """A user's environment: what it holds cannot be hashed."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self) -> None:
        self.inner = CartPole(max_episode_steps=5)
        self.observation_space, self.action_space = self.inner.observation_space, self.inner.action_space
        self.reset, self.step, self.max_episode_steps = self.inner.reset, self.inner.step, 5


def test_an_environment_that_cannot_be_hashed_trains():
    trainer = Trainer(OwnEnv(), CONFIG, 0)
    assert trainer.template().observation.shape == (2, 4)
