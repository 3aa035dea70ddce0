"""The five environments in JAX against Gymnasium's: the same states and actions must lead to the same steps.

Gymnasium computes in float64 and rounds what it shows to float32; we compute in float32. So one step from the
same float32 state may differ in the last digits (by `TOLERANCE`; where a step magnifies, as Acrobot's do at
speeds no episode reaches, by what moving Gymnasium's own state by single units in the last place does),
and an episode may end differently only where Gymnasium's state is within `NEAR_LIMIT` of the limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from sympol.envs.classic.acrobot import Acrobot, AcrobotState
from sympol.envs.classic.cartpole import ANGLE_LIMIT, POSITION_LIMIT, CartPole, CartPoleState
from sympol.envs.classic.mountain_car import MountainCar, MountainCarContinuous, MountainCarState
from sympol.envs.classic.pendulum import Pendulum, PendulumState
from sympol.envs.env import Env

NUM_STEPS = 100_000  # of each environment
TOLERANCE = 1e-5  # of each number of an observation, and of the reward, absolute and relative
NEAR_LIMIT = 1e-6  # where float32 may fall on the other side of a limit
PI = np.pi

Physics = NDArray[np.float32]


@dataclass(frozen=True)
class Case:
    """An environment, its twin in Gymnasium, and the box its states can be in."""

    id: str
    env: Env
    state: Callable[..., Any]
    low: tuple[float, ...]
    high: tuple[float, ...]
    edges: tuple[tuple[int, float], ...]  # (quantity, value): walls, limits, goals, places where angles wrap
    margin: Callable[[NDArray[np.float64]], NDArray[np.float64]]  # its sign says whether the episode ends
    policy: Callable[[Any], Any]  # a simple one that reaches the goal, where there is one
    idle: Callable[[Any], Any]  # one that lasts till the time limit


def pump(velocity: Any) -> Any:
    """Push the way it moves."""
    return jnp.where(velocity < 0, 0, 2).astype(jnp.int32)


def balance(x: Any) -> Any:
    """Push the cart under where the pole is falling."""
    return (x[..., 2] + 0.5 * x[..., 3] > 0).astype(jnp.int32)


def coast(x: Any) -> Any:
    return jnp.ones(x.shape[:-1], jnp.int32)


def no_force(x: Any) -> Any:
    return jnp.zeros((*x.shape[:-1], 1), jnp.float32)


CASES = [
    Case(
        id="CartPole-v1",
        env=CartPole(),
        state=CartPoleState,
        low=(-2.5, -4, -0.25, -4),
        high=(2.5, 4, 0.25, 4),
        edges=((0, -POSITION_LIMIT), (0, POSITION_LIMIT), (2, -ANGLE_LIMIT), (2, ANGLE_LIMIT)),
        margin=lambda s: np.maximum(np.abs(s[:, 0]) - POSITION_LIMIT, np.abs(s[:, 2]) - ANGLE_LIMIT),
        policy=balance,
        idle=balance,
    ),
    Case(
        id="Acrobot-v1",
        env=Acrobot(),
        state=AcrobotState,
        low=(-PI, -PI, -4 * PI, -9 * PI),
        high=(PI, PI, 4 * PI, 9 * PI),
        edges=((0, PI), (0, -PI), (1, PI), (1, -PI), (2, 4 * PI), (2, -4 * PI), (3, 9 * PI), (3, -9 * PI)),
        margin=lambda s: -np.cos(s[:, 0]) - np.cos(s[:, 0] + s[:, 1]) - 1,
        policy=lambda x: pump(x[..., 4]),
        idle=coast,
    ),
    Case(
        id="Pendulum-v1",
        env=Pendulum(),
        state=PendulumState,
        low=(-PI, -8),
        high=(PI, 8),
        edges=((0, PI), (0, -PI), (0, 0), (1, 8), (1, -8)),
        margin=lambda s: np.full(len(s), -np.inf),
        policy=lambda x: jnp.where(x[..., 2:] < 0, -1.7, 1.9).astype(jnp.float32),
        idle=no_force,
    ),
    Case(
        id="MountainCar-v0",
        env=MountainCar(),
        state=MountainCarState,
        low=(-1.2, -0.07),
        high=(0.6, 0.07),
        edges=((0, -1.2), (0, 0.6), (0, 0.5), (1, 0.07), (1, -0.07), (1, 0)),
        margin=lambda s: np.minimum(s[:, 0] - 0.5, s[:, 1]),
        policy=lambda x: pump(x[..., 1]),
        idle=coast,
    ),
    Case(
        id="MountainCarContinuous-v0",
        env=MountainCarContinuous(),
        state=MountainCarState,
        low=(-1.2, -0.07),
        high=(0.6, 0.07),
        edges=((0, -1.2), (0, 0.6), (0, 0.45), (1, 0.07), (1, -0.07), (1, 0)),
        margin=lambda s: np.minimum(s[:, 0] - 0.45, s[:, 1]),
        policy=lambda x: jnp.where(x[..., 1:] < 0, -0.9, 0.8).astype(jnp.float32),
        idle=no_force,
    ),
]
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)


class Steps(NamedTuple):
    """What one step from each of many states gave; ``physics`` is the state it led to."""

    physics: NDArray[np.floating]
    observation: NDArray[np.float32]
    reward: NDArray[np.floating]
    terminated: NDArray[np.bool_]


def sample_actions(case: Case, rng: np.random.Generator, num_steps: int) -> NDArray:
    space = case.env.action_space
    if isinstance(space, gymnasium.spaces.Discrete):
        return rng.integers(space.n, size=num_steps)
    assert isinstance(space, gymnasium.spaces.Box)
    # a quarter beyond the bounds: what is done with those is part of the rules
    return rng.uniform(1.25 * space.low, 1.25 * space.high, (num_steps, 1)).astype(np.float32)


def uniform_states(case: Case, rng: np.random.Generator, num_states: int) -> Physics:
    """States anywhere in the box, half of them moved close to a wall, a limit or a goal."""
    states = rng.uniform(case.low, case.high, (num_states, len(case.low)))
    for row, edge in zip(
        range(0, num_states, 2), rng.integers(len(case.edges), size=num_states), strict=False
    ):
        quantity, value = case.edges[edge]
        states[row, quantity] = value + rng.choice([0, 1e-7, 1e-4, 1e-2]) * rng.uniform(-1, 1)
    return np.clip(states, case.low, case.high).astype(np.float32)


def step_gymnasium(case: Case, states: Physics, actions: NDArray) -> Steps:
    env: Any = gymnasium.make(case.id).unwrapped
    env.reset(seed=0)
    rows = []
    for state, action in zip(states.astype(np.float64), actions, strict=True):
        env.state = state
        env.steps_beyond_terminated = None  # or CartPole would warn of a state beyond its limits
        observation, reward, terminated, truncated, _ = env.step(action)
        assert not truncated
        rows.append((env.state, observation, reward, terminated))
    return Steps(*(np.array(column) for column in zip(*rows, strict=True)))


def step_jax(case: Case, states: Physics, actions: NDArray) -> Steps:
    if actions.dtype == np.int64:
        actions = actions.astype(np.int32)
    state = case.state(jnp.asarray(states), jnp.zeros(len(states), jnp.int32))
    step = jax.jit(jax.vmap(case.env.step, in_axes=(None, 0, 0)))
    state, result = step(jax.random.key(0), state, jnp.asarray(actions))
    columns = state.physics, result.observation, result.reward, result.terminated
    return Steps(*(np.asarray(column) for column in columns))


def episode_states(case: Case, rng: np.random.Generator, num_states: int) -> Physics:
    """States that episodes of Gymnasium's visit, half of the actions at random, half by the policy."""
    env: Any = gymnasium.make(case.id)
    observation, _ = env.reset(seed=int(rng.integers(2**31)))
    actions = sample_actions(case, rng, num_states)
    by_policy = rng.uniform(size=num_states) < 0.5
    policy = jax.jit(case.policy)
    states = []
    for action, informed in zip(actions, by_policy, strict=True):
        states.append(env.unwrapped.state)
        action = np.asarray(policy(observation)) if informed else action
        observation, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            observation, _ = env.reset()
    return np.array(states)


def allowance(case: Case, states: Physics, actions: NDArray, observation: NDArray) -> NDArray:
    """How far float32 may lead away: ten times what the smallest changes of Gymnasium's own state do."""
    moved = np.zeros_like(observation)
    for quantity in range(states.shape[1]):
        nudged = states.copy()
        nudged[:, quantity] = np.nextafter(states[:, quantity], np.float32(np.inf))
        moved += np.abs(step_gymnasium(case, nudged, actions).observation - observation)
    return TOLERANCE + 10 * moved


@each_case
def test_one_step_equals_gymnasiums(case: Case) -> None:
    rng = np.random.default_rng(0)
    visited = episode_states(case, rng, 20_000)
    if case.id == "Pendulum-v1":  # Gymnasium lets the angle run, ours stays on the circle
        visited[:, 0] = (visited[:, 0] + PI) % (2 * PI) - PI
    states = np.concatenate([visited.astype(np.float32), uniform_states(case, rng, NUM_STEPS - len(visited))])
    actions = sample_actions(case, rng, NUM_STEPS)

    theirs, ours = step_gymnasium(case, states, actions), step_jax(case, states, actions)

    error = np.abs(ours.observation - theirs.observation)
    far = (error > TOLERANCE * (1 + np.abs(theirs.observation))).any(axis=1)
    assert not far[: len(visited)].any()
    assert far.mean() < (0.01 if case.id == "Acrobot-v1" else 1e-12)
    if far.any():
        assert (error[far] < allowance(case, states[far], actions[far], theirs.observation[far])).all()

    differs = ours.terminated != theirs.terminated
    near = np.abs(case.margin(theirs.physics.astype(np.float64))) < NEAR_LIMIT
    assert not (differs & ~near & ~far).any()
    assert differs.sum() <= NUM_STEPS // 5000
    same = ~differs
    np.testing.assert_allclose(ours.reward[same], theirs.reward[same], TOLERANCE, TOLERANCE)


@each_case
@pytest.mark.parametrize("way", ["policy", "idle"])
def test_whole_episodes_equal_gymnasiums(case: Case, way: str) -> None:
    """From the same first state, each by its own observations, to the same end with the same return.

    The states themselves drift apart: a force that switches at zero makes of a last digit a whole step.
    """
    policy = jax.jit(getattr(case, way))
    step = jax.jit(case.env.step)
    theirs: Any = gymnasium.make(case.id)
    ends = set()
    for seed in range(3):
        observation, _ = theirs.reset(seed=seed)
        state = case.state(jnp.asarray(theirs.unwrapped.state, jnp.float32), jnp.int32(0))
        x = observation
        their_return = our_return = 0.0
        for _ in range(1000):
            observation, reward, *their_end, _ = theirs.step(np.asarray(policy(observation)))
            state, (x, our_reward, *our_end) = step(jax.random.key(0), state, policy(x))
            their_return += float(reward)
            our_return += float(our_reward)
            assert [bool(end) for end in our_end] == their_end
            if any(their_end):
                break
        ends.add(tuple(their_end))
        assert our_return == pytest.approx(their_return, rel=1e-5)
    if way == "idle":
        assert ends == {(False, True)}


@each_case
def test_time_limit_is_gymnasiums(case: Case) -> None:
    spec = gymnasium.spec(case.id)
    assert case.env.max_episode_steps == spec.max_episode_steps  # type: ignore[attr-defined]


@each_case
def test_spaces_equal_gymnasiums(case: Case) -> None:
    theirs = gymnasium.make(case.id)
    assert case.env.observation_space == theirs.observation_space
    assert case.env.action_space == theirs.action_space


@each_case
def test_first_observations_are_distributed_as_gymnasiums(case: Case) -> None:
    """Two-sample Kolmogorov–Smirnov of each feature: the distance exceeds this bound once in 10,000 draws."""
    num = 4000
    _, ours = jax.vmap(case.env.reset)(jax.random.split(jax.random.key(0), num))
    theirs: Any = gymnasium.make(case.id)
    theirs.reset(seed=0)
    for mine, other in zip(
        np.asarray(ours).T, np.array([theirs.reset()[0] for _ in range(num)]).T, strict=True
    ):
        both = np.sort(np.concatenate([mine, other]))
        below = [np.searchsorted(np.sort(sample), both, side="right") / num for sample in (mine, other)]
        assert np.abs(below[0] - below[1]).max() < 2.23 * np.sqrt(2 / num)
        spread = np.ptp(other)
        np.testing.assert_allclose(mine.min(), other.min(), atol=0.005 * spread + 1e-7)
        np.testing.assert_allclose(mine.max(), other.max(), atol=0.005 * spread + 1e-7)
        np.testing.assert_allclose(mine.mean(), other.mean(), atol=0.05 * spread + 1e-7)
