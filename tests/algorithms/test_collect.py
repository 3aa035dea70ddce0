"""What the rollout holds: fresh noise everywhere, true last observations, actions as they were sampled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from sympol.algorithms.config import Config
from sympol.algorithms.trainer import make_loop
from sympol.types import Step, Transition

STARTED = 100.0
"""The second feature of every first observation; after that it counts steps."""


class TellState(NamedTuple):
    noise: Array
    time: Array


@dataclass(frozen=True)
class Tell:
    """Tells everything: observes the random number it was stepped with and the time, pays the action it got.

    Ends by itself after three steps if the noise is high, else by the clock after five.
    """

    max_episode_steps: int = 5

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-0.1, 0.1, (1,), np.float32)

    def reset(self, key: Array) -> tuple[TellState, Array]:
        noise = jax.random.uniform(key)
        return TellState(noise, jnp.int32(0)), jnp.stack([noise, jnp.float32(STARTED)])

    def step(self, key: Array, state: TellState, action: Array) -> tuple[TellState, Step]:
        noise, time = jax.random.uniform(key), state.time + 1
        observation = jnp.stack([noise, time.astype(jnp.float32)])
        terminated = (time >= 3) & (noise > 0.5)
        return TellState(noise, time), Step(
            observation, action[0], terminated, time >= self.max_episode_steps
        )


CHUNK_STEPS, NUM_ENVS, NUM_CHUNKS = 16, 3, 2


@pytest.fixture(scope="module")
def rollouts() -> tuple[Array, list[Transition], list[Array]]:
    """The first observations, two rollouts in a row, and the observations after each."""
    env = Tell()
    config = Config(
        depth=2,
        num_envs=NUM_ENVS,
        num_steps=16,
        total_timesteps=8 * 4 * 48,
        normalize_obs=False,
        log_std_init=0.5,
    )
    loop = make_loop(env, config)

    @jax.jit
    def run(key):
        state = loop.begin(config.hyperparameters(), jnp.uint32(0), loop.template())
        first = state.observation

        def one(state, key):
            state, experience = loop.rollouts.collect(state, loop.rollouts.buffer(), jnp.int32(1), key)
            return state, (experience.rollout, state.observation)

        _, (rollouts, after) = jax.lax.scan(one, state, jax.random.split(key, 2))
        return first, rollouts, after

    first, both, after = run(jax.random.key(0))
    return first, [jax.tree.map(lambda a, i=i: np.asarray(a[i]), both) for i in range(2)], list(after)


def in_time(array: np.ndarray) -> np.ndarray:
    """The collected chunks, one step after the other: [steps, envs, …]."""
    return array[:NUM_CHUNKS].reshape(NUM_CHUNKS * CHUNK_STEPS, *array.shape[2:])


def test_only_the_chunks_asked_for_are_filled(rollouts):
    for rollout in rollouts[1]:
        assert rollout.reward.shape == (4, CHUNK_STEPS, NUM_ENVS)
        assert np.all(rollout.observation[NUM_CHUNKS:] == 0)
        assert np.all(rollout.observation[:NUM_CHUNKS, ..., 1] > 0)


def test_no_random_number_comes_twice(rollouts):
    """Of the environments' steps, of their resets, of the policy: over steps, environments, chunks, rollouts."""
    steps = np.concatenate([in_time(r.last_observation)[..., 0].ravel() for r in rollouts[1]])
    assert len(np.unique(steps)) == len(steps)
    starts = [np.asarray(rollouts[0])[:, 0]]
    for rollout in rollouts[1]:
        observation = in_time(rollout.observation)
        starts.append(observation[1:][observation[1:, :, 1] == STARTED][:, 0])
    starts = np.concatenate(starts)
    assert len(starts) > 20
    assert len(np.unique(starts)) == len(starts)
    assert not set(starts.tolist()) & set(steps.tolist())
    # log_std is positive and the leaves are near zero: two equal actions mean equal noise
    actions = np.concatenate([in_time(r.action).ravel() for r in rollouts[1]])
    assert len(np.unique(actions)) == len(actions)
    assert abs(np.corrcoef(actions[:-1], actions[1:])[0, 1]) < 0.2
    assert abs(actions.std() - np.exp(0.5)) < 0.3


def test_actions_are_stored_as_sampled_and_sent_clipped(rollouts):
    for rollout in rollouts[1]:
        action, reward = in_time(rollout.action)[..., 0], in_time(rollout.reward)
        assert np.mean(np.abs(action) > 0.1) > 0.5
        np.testing.assert_array_equal(reward, np.clip(action, np.float32(-0.1), np.float32(0.1)))


def test_a_reset_never_leaks(rollouts):
    """The row after an end begins an episode; the end itself keeps what it really saw."""
    first, (one, two), (after_one, after_two) = rollouts
    assert np.any(in_time(one.terminated))
    assert np.any(in_time(one.truncated))
    for rollout, begin, end in ((one, first, after_one), (two, after_one, after_two)):
        observation, last = in_time(rollout.observation), in_time(rollout.last_observation)
        done = in_time(rollout.terminated) | in_time(rollout.truncated)
        np.testing.assert_array_equal(observation[0], begin)
        following = np.concatenate([observation[1:], np.asarray(end)[None]])
        np.testing.assert_array_equal(following[~done], last[~done])
        assert np.all(following[done][:, 1] == STARTED)
        assert np.all(last[..., 1] <= 5)
        np.testing.assert_array_equal(in_time(rollout.truncated), last[..., 1] == 5)
        np.testing.assert_array_equal(in_time(rollout.terminated), (last[..., 1] >= 3) & (last[..., 0] > 0.5))
