"""Training episodes on the host live on across validations, and across a resume by replay."""

from __future__ import annotations

import dataclasses
import warnings
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest

from sympol.agents import agent_of
from sympol.algorithms import replay
from sympol.algorithms.replay import EpisodesRestarted, longest_replay
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import Trainer
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.runs import checkpoint

from .test_host_training import CARTPOLE, CONFIG, assert_same_bits

LENGTH = 300
CONFIG = dataclasses.replace(CONFIG, num_eval_episodes=2, num_epochs=1)
"""Four copies; 512 steps between two validations are 128 of each copy."""


class Walk(gymnasium.Env):
    """A walk that depends on everything since its reset: on the seed, on chance at each step, and on the actions.

    Episodes last 300 steps. What happened to whom is noted in ``notes``.
    """

    observation_space = CARTPOLE.observation_space
    action_space = CARTPOLE.action_space
    notes: list[tuple[int, int, float]]

    def __init__(self, length: int = LENGTH, follows_seed: bool = True) -> None:
        self.length, self.follows_seed = length, follows_seed
        self.reached: list[int] = []

    def _observe(self) -> np.ndarray:
        return np.float32([self.place, self.time / 100, 0, 0])

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed if self.follows_seed else None)
        self.place, self.time = float(self.np_random.uniform(-1, 1)), 0
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.time += 1
        self.place = 0.9 * self.place + 0.1 * (2 * action - 1) + 0.1 * float(self.np_random.normal())
        self.reached.append(self.time)
        return self._observe(), self.place, False, self.time == self.length, {}


def spec_of(made: list[Walk] | None = None, **options: Any) -> EnvSpec:
    def make() -> Walk:
        env = Walk(**options)
        if made is not None:
            made.append(env)
        return env

    return resolve(make)


def advance(spec: EnvSpec, state: TrainState | None, *stops: int) -> TrainState:
    trainer = Trainer(spec, CONFIG, 0)
    try:
        for stop in stops:
            state = trainer.advance(state, stop)
        assert state is not None
        return jax.tree.map(np.array, state)  # nothing but the arrays is left over
    finally:
        trainer.close()


@pytest.fixture(scope="module")
def uninterrupted() -> TrainState:
    return advance(spec_of(), None, 512, 1024, 1536, 2048)


def test_an_episode_that_is_longer_than_the_time_between_two_validations_is_seen_to_its_end():
    made: list[Walk] = []
    state = advance(spec_of(made), None, 512, 1024, 1536)
    training = made[1:5]  # the first was only looked at
    for env in training:
        assert env.reached == [*range(1, 301), *range(1, 385 - 300)]
    assert int(state.episodes.num_ended) == 4  # all in the third segment
    assert int(state.episodes.sum_length) == 4 * LENGTH
    for env in made[5:]:  # validated on
        assert env.reached == [*range(1, 301)] * 3


def test_a_resumed_training_is_the_uninterrupted_one_to_the_bit(uninterrupted):
    """Inside the first episode, inside the second, and with a validation of its own in between."""
    assert_same_bits(advance(spec_of(), advance(spec_of(), None, 512), 1024, 1536, 2048), uninterrupted)
    assert_same_bits(advance(spec_of(), advance(spec_of(), None, 512, 1024, 1536), 2048), uninterrupted)


def test_a_checkpoint_holds_the_running_episodes(uninterrupted, tmp_path):
    saved = advance(spec_of(), None, 512)
    trainer = Trainer(spec_of(), CONFIG, 0)
    checkpoint.save(tmp_path, saved._replace(metrics={}), 512)
    like = trainer.template()._replace(metrics={})
    loaded, _ = checkpoint.load_latest(tmp_path, lambda _: like)
    assert loaded.env_state.actions.shape == (128, 4)
    assert_same_bits(
        advance(spec_of(), loaded._replace(metrics=saved.metrics), 1024, 1536, 2048), uninterrupted
    )
    # a checkpoint of an earlier version has none, and new episodes begin
    old = saved._replace(metrics={}, env_state=None)
    checkpoint.save(tmp_path, old, 513)
    loaded, _ = checkpoint.load_latest(tmp_path, lambda _: like)
    assert len(loaded.env_state.length) == 0
    made: list[Walk] = []
    advance(spec_of(made), loaded._replace(metrics=saved.metrics), 1024)
    assert made[1].reached[0] == 1
    assert len(made[1].reached) == 128


def test_a_validation_alone_changes_nothing(uninterrupted):
    """As where a tree is pruned between two segments, and the copies are closed."""
    state = advance(spec_of(), advance(spec_of(), None, 512), 512)
    assert len(state.env_state.actions) == 128
    assert_same_bits(advance(spec_of(), state, 1024, 1536, 2048).networks, uninterrupted.networks)


def test_where_the_environment_does_not_follow_its_seed_new_episodes_begin_and_a_warning_says_so():
    saved = advance(spec_of(follows_seed=False), None, 512)
    made: list[Walk] = []
    with pytest.warns(EpisodesRestarted, match="4 of 4 training episodes begin anew") as said:
        state = advance(spec_of(made, follows_seed=False), saved, 1024)
    assert "\n" not in str(said[0].message)
    assert made[1].reached == [*range(1, 129), *range(1, 129)]
    assert (np.asarray(state.episodes.running_length) == 128).all()


def test_an_episode_too_long_to_be_replayed_begins_anew_after_a_validation_resumed_or_not(monkeypatch):
    monkeypatch.setattr(replay, "MAX_EPISODE_STEPS", 200)
    endless: dict[str, Any] = {"length": 10**9}
    made: list[Walk] = []
    config = dataclasses.replace(CONFIG, num_eval_episodes=1)
    trainer = Trainer(spec_of(made, **endless), config, 0)
    states = [trainer.advance(None, 512)]
    for stop in (1024, 1536):
        states.append(trainer.advance(states[-1], stop))
    trainer.close()
    for env in made[1:5]:
        assert env.reached == [*range(1, 257), *range(1, 129)]
    again = Trainer(spec_of(**endless), config, 0)
    resumed = again.advance(jax.tree.map(np.array, states[1]), 1536)
    again.close()
    assert_same_bits(resumed, states[2])
    assert (np.asarray(resumed.episodes.running_length) == 128).all()


def test_where_there_is_one_copy_validation_interrupts_its_episode():
    env = Walk()
    config = dataclasses.replace(CONFIG, num_envs=1, num_steps=64, num_eval_episodes=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        agent = agent_of(resolve(env), dataclasses.replace(config, total_timesteps=256, num_evals=2), 0)
        agent.learn(progress_bar=False)
    assert env.reached == [*range(1, 129), *range(1, 301)] * 2
    assert agent.state is not None
    assert len(agent.state.env_state.length) == 0


def test_what_is_replayed_is_bounded():
    one, many = np.zeros(8, np.int32), np.zeros((64, 20), np.float32)
    assert longest_replay(None, one) == 10_000
    assert longest_replay(500, one) == 10_000
    assert longest_replay(35_040, one) == 35_040
    assert longest_replay(35_040, many) == (1 << 26) // (64 * 20 * 4)
