"""Every environment in JAX, the five and the probes, keeps the protocol."""

from __future__ import annotations

import doctest
from typing import Any
from unittest.mock import patch

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.envs import env as protocol
from sympol.envs.classic.acrobot import Acrobot
from sympol.envs.classic.cartpole import CartPole
from sympol.envs.classic.mountain_car import MountainCar, MountainCarContinuous
from sympol.envs.classic.pendulum import Pendulum
from sympol.envs.entries import REGISTERED
from sympol.envs.env import Env

from .probes import PROBES, ContinuousMatch, Discount, MatchObservation, MultiDiscreteMatch, TimeLimit

CLASSIC = (CartPole(), Acrobot(), Pendulum(), MountainCar(), MountainCarContinuous())
each_env = pytest.mark.parametrize("env", [*CLASSIC, *PROBES], ids=lambda env: type(env).__name__)


def an_action(space: gymnasium.Space) -> jax.Array:
    dtype = jnp.float32 if isinstance(space, gymnasium.spaces.Box) else jnp.int32
    return jnp.asarray(space.sample(), dtype)


@each_env
def test_it_is_an_environment_in_float32(env: Any) -> None:
    assert isinstance(env, Env)
    space = env.observation_space
    with jax.numpy_dtype_promotion("strict"), jax.numpy_rank_promotion("raise"):
        state, observation = env.reset(jax.random.key(0))
        assert observation.dtype == jnp.float32
        assert space.contains(np.asarray(observation))
        new_state, step = env.step(jax.random.key(1), state, an_action(env.action_space))
    assert (step.observation.shape, step.observation.dtype) == (space.shape, jnp.float32)
    assert (step.reward.shape, step.reward.dtype) == ((), jnp.float32)
    for end in (step.terminated, step.truncated):
        assert (end.shape, end.dtype) == ((), jnp.bool_)
    # what a compiled loop carries may change neither its type nor the weakness of it
    assert jax.tree.map(jax.typeof, state) == jax.tree.map(jax.typeof, new_state)
    assert jax.typeof(observation) == jax.typeof(step.observation)


@each_env
def test_it_maps_over_environments(env: Any) -> None:
    num_envs = 3
    state, observation = jax.vmap(env.reset)(jax.random.split(jax.random.key(0), num_envs))
    assert observation.shape == (num_envs, *env.observation_space.shape)
    actions = jnp.stack([an_action(env.action_space)] * num_envs)
    _, step = jax.vmap(env.step)(jax.random.split(jax.random.key(1), num_envs), state, actions)
    assert all(leaf.shape[0] == num_envs for leaf in step)


@each_env
def test_truncated_at_the_time_limit(env: Any) -> None:
    state, _ = env.reset(jax.random.key(0))
    action = an_action(env.action_space)
    for time, truncated in ((env.max_episode_steps - 2, False), (env.max_episode_steps - 1, True)):
        late = state._replace(time=jnp.int32(time))
        assert bool(env.step(jax.random.key(1), late, action)[1].truncated) is truncated


@pytest.mark.parametrize(
    ("env", "first", "action", "reward"),
    [
        (MatchObservation(), [1.0], 1, 1),
        (MatchObservation(), [-1.0], 1, -1),
        (ContinuousMatch(), [0.5], [0.5], 0),
        (ContinuousMatch(), [0.5], [-0.5], -1),
        (MultiDiscreteMatch(), [1.0, -1.0], [1, 0], 2),
        (MultiDiscreteMatch(), [-1.0, 1.0], [1, 2], 1),
        (Discount(), [0.0], 0, 0),
        (Discount(), [1.0], 0, 1),
    ],
)
def test_probes_pay_what_they_say(env: Any, first: list[float], action: Any, reward: float) -> None:
    state, _ = env.reset(jax.random.key(0))
    state = state._replace(observation=jnp.array(first))
    assert env.step(jax.random.key(1), state, jnp.asarray(action))[1].reward == reward


def test_the_time_limit_probe_is_never_terminated() -> None:
    env = TimeLimit()
    state, _ = env.reset(jax.random.key(0))
    ends = []
    for _ in range(5):
        state, step = env.step(jax.random.key(1), state, jnp.int32(0))
        ends.append((bool(step.terminated), bool(step.truncated)))
    assert ends == [(False, False)] * 4 + [(False, True)]


@patch.dict(REGISTERED)
def test_the_example_of_the_protocol_runs():
    results = doctest.testmod(protocol)
    assert (results.failed, results.attempted) == (0, 10)
