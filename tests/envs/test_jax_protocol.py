"""What a user's environment in JAX returns is made to keep the protocol, or named in one line."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.envs.classic.cartpole import CartPole
from sympol.envs.env import Env
from sympol.envs.jax_protocol import JaxEnv, kept_to_protocol
from sympol.envs.registry import resolve
from sympol.types import Step

from .probes import PROBES

TINY: dict[str, Any] = {"num_envs": 2, "num_steps": 16, "depth": 2, "total_timesteps": 256, "num_evals": 2}
STILL = np.zeros(2, np.float32)


class Walk:
    """A random walk by a key in its state; pays 1 for the action that is the sign of the last step."""

    observation_space = Box(-9, 9, (2,))
    action_space = Discrete(2)
    max_episode_steps: Any = None
    feature_names = ("place", "last")

    def reset(self, key: Any) -> Any:
        return {"key": key, "x": jnp.zeros(2, int), "time": 0}, jnp.zeros(2, int)

    def step(self, key: Any, state: Any, action: Any) -> Any:
        own, now = jax.random.split(state["key"])
        last = jnp.where(jax.random.bernoulli(now), 1, -1)
        x = jnp.stack([state["x"][0] + last, last])
        reward = jnp.where((state["x"][1] > 0) == (action == 1), 1, 0)
        time = state["time"] + 1
        return {"key": own, "x": x, "time": time}, Step(x, reward, time >= 8, False)


def walk(**changed: Any) -> Any:
    return type("Walk", (Walk,), changed)()


def answering(**changed: Any) -> Any:
    """Whose state is a number, and whose step answers this."""
    answer = {"observation": STILL, "reward": 1.0, "terminated": False, "truncated": False} | changed
    return walk(
        reset=lambda self, key: (jnp.float32(0), jnp.zeros(2)),
        step=lambda self, key, state, action: (state, Step(**answer)),
    )


def test_keys_integers_and_bools_are_made_to_fit() -> None:
    env = resolve(Walk()).env
    assert isinstance(env, JaxEnv)
    assert isinstance(env, Env)
    assert env == kept_to_protocol(env.env)
    assert env.feature_names == Walk.feature_names
    assert not hasattr(env, "max_episode_steps")
    state, observation = env.reset(jax.random.key(3))
    after, step = env.step(jax.random.key(0), state, jnp.int32(1))
    assert jax.tree.map(jax.typeof, state) == jax.tree.map(jax.typeof, after)
    assert state["key"].dtype == jnp.uint32
    assert observation.dtype == step.observation.dtype == step.reward.dtype == jnp.float32
    assert step.terminated.dtype == step.truncated.dtype == jnp.bool_
    theirs, _ = Walk().step(jax.random.key(0), Walk().reset(jax.random.key(3))[0], jnp.int32(1))
    np.testing.assert_array_equal(after["key"], jax.random.key_data(theirs["key"]))


def test_what_keeps_the_protocol_is_left_alone() -> None:
    for env in (*PROBES, CartPole()):
        assert kept_to_protocol(env) is env


@pytest.mark.parametrize(
    "changed",
    [
        {"reward": 1},
        {"reward": jnp.int32(1)},
        {"reward": jnp.ones(1)},
        {"reward": np.float64(1)},
        {"reward": True},
        {"terminated": jnp.float32(0)},
        {"terminated": 0},
        {"truncated": np.zeros(1, bool)},
        {"observation": np.zeros(2, int)},
        {"observation": np.zeros(2, np.float64)},
        {"observation": jnp.zeros(2, jnp.bfloat16)},
    ],
    ids=str,
)
def test_numbers_of_another_kind_are_cast(changed: Any) -> None:
    env = resolve(answering(**changed)).env
    assert env is not None
    _, step = env.step(jax.random.key(0), env.reset(jax.random.key(0))[0], jnp.int32(0))
    for number, dtype in zip(step, (jnp.float32, jnp.float32, jnp.bool_, jnp.bool_), strict=True):
        assert (number.shape, number.dtype) == (STILL.shape if number.ndim else (), dtype)
    assert step.reward == 1


LIMITS = [(None, None), (5, 5), (np.int64(5), 5), (5.0, 5), (jnp.int32(5), 5)]


@pytest.mark.parametrize(("limit", "steps"), LIMITS, ids=[repr(limit) for limit, _ in LIMITS])
def test_a_time_limit(limit: Any, steps: int | None) -> None:
    spec = resolve(walk(max_episode_steps=limit))
    assert spec.max_episode_steps == steps
    assert getattr(spec.env, "max_episode_steps", None) == steps


def state_after(function: Any) -> Any:
    return walk(step=lambda self, key, state, action: (function(state), Step(STILL, 1.0, False, False)))


WRONG: dict[str, tuple[Any, str]] = {
    "observation of reset": (
        walk(reset=lambda self, key: (0, jnp.zeros(3))),
        "the observation that reset() of Walk returns must be an array of numbers of shape (2,)",
    ),
    "swapped": (
        walk(reset=lambda self, key: (jnp.zeros(2), {"a": 0})),
        "the observation that reset() of Walk",
    ),
    "reset alone": (
        walk(reset=lambda self, key: jnp.zeros(2)),
        "reset() of Walk must return (state, observation)",
    ),
    "observation": (
        answering(observation=jnp.zeros((2, 1))),
        "the observation that step() of Walk returns must be",
    ),
    "reward": (answering(reward=jnp.zeros(2)), "the reward that step() of Walk returns must be one number"),
    "no reward": (answering(reward=None), "the reward that step() of Walk returns must be one number"),
    "complex": (answering(reward=1j), "the reward that step() of Walk returns must be one number"),
    "terminated": (answering(terminated=jnp.zeros(2, bool)), "the terminated that step() of Walk returns"),
    "truncated": (answering(truncated=None), "the truncated that step() of Walk returns must be one number"),
    "gymnax": (
        walk(step=lambda self, key, state, action: (STILL, state, 0.0, False, {})),
        "step() of Walk must return (state, Step(...)), got a tuple of 5 values",
    ),
    "no step": (
        walk(step=lambda self, key, state, action: (state, (STILL, 1.0, True))),
        "(state, Step(observation, reward, terminated, truncated)), got (state, a tuple of 3 values)",
    ),
    "dtype": (
        state_after(lambda s: {**s, "x": s["x"] / 2}),
        "state['x'] is float32 of shape (2,) after step()",
    ),
    "shape": (
        state_after(lambda s: {**s, "x": s["x"][:1]}),
        "state['x'] is int32 of shape (1,) after step()",
    ),
    "structure": (state_after(lambda s: {"key": s["key"]}), "state['time'] is not there after step()"),
    "raw key": (
        state_after(lambda s: {**s, "key": jax.random.key_data(s["key"])}),
        "state['key'] is uint32 of shape (2,) after step()",
    ),
    "list": (state_after(lambda s: tuple(s.values())), "the state that step() of Walk returns must be"),
    "if": (
        walk(step=lambda self, key, state, action: (state, Step(STILL, 1.0, bool(action > 0), False))),
        "step() of Walk must be a function that JAX can trace, and it raised TracerBoolConversionError",
    ),
    "arguments": (walk(step=lambda self, key, state: None), "and it raised TypeError"),
    "limit": (
        walk(max_episode_steps="many"),
        "max_episode_steps of Walk must be a positive whole number, or None",
    ),
    "no steps": (walk(max_episode_steps=0), "max_episode_steps of Walk must be a positive whole number"),
}


@pytest.mark.parametrize(("env", "says"), WRONG.values(), ids=WRONG)
def test_what_cannot_work_is_named_in_one_line(env: Any, says: str) -> None:
    with pytest.raises(ValueError, match="Walk") as error:
        resolve(env)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_a_training_with_keys_in_its_state_goes_on_to_the_byte(tmp_path: Any) -> None:
    env = Walk()
    whole = sympol.PPO("tree", env, **TINY).learn(progress_bar=False)
    halted = sympol.PPO("tree", env, **TINY)
    halted.learn(callback=lambda report: False, progress_bar=False)
    halted.save(tmp_path / "run")
    resumed = sympol.load(tmp_path / "run", env=env).learn(progress_bar=False)
    assert halted.num_timesteps < resumed.num_timesteps == whole.num_timesteps
    assert resumed.state is not None
    for ours, theirs in zip(jax.tree.leaves(resumed.state), jax.tree.leaves(whole.state), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert resumed.tree() == whole.tree()
