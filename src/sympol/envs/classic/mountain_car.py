"""MountainCar-v0 and MountainCarContinuous-v0: Moore's underpowered car in a valley, as Gymnasium has it.

The two share the valley and differ in the motor, the goal and the reward.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ...types import Step

GRAVITY = 0.0025  # position per step², along the slope cos(3·position)
POSITION_LIMITS = (-1.2, 0.6)
SPEED_LIMIT = 0.07  # position per step
START = (-0.6, -0.4)  # position at rest, around the valley's floor


class MountainCarState(NamedTuple):
    """Position, velocity (position per step); steps taken."""

    physics: Float[Array, " 2"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class MountainCar:
    """Reach the hilltop by swinging up; reward −1 a step, the end at position 0.5."""

    max_episode_steps: int = 200

    feature_names: ClassVar[tuple[str, ...]] = ("position", "velocity")
    action_names: ClassVar[tuple[str, ...]] = ("push left", "no push", "push right")
    goal: ClassVar[float] = 0.5
    force: ClassVar[float] = 0.001

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Position, velocity."""
        return _observation_space()

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        """Push to the left, not at all, to the right."""
        return gymnasium.spaces.Discrete(3)

    def reset(self, key: PRNGKeyArray) -> tuple[MountainCarState, Float[Array, " 2"]]:
        """Start at rest, uniform in [−0.6, −0.4]."""
        return _reset(key)

    def step(
        self, key: PRNGKeyArray, state: MountainCarState, action: Int[Array, ""]
    ) -> tuple[MountainCarState, Step]:
        """One step of the clock."""
        physics = _drive(state.physics, self.force * (action.astype(jnp.float32) - 1))
        time = state.time + 1
        return MountainCarState(physics, time), Step(
            physics, jnp.float32(-1), _at_goal(physics, self.goal), time >= self.max_episode_steps
        )


@dataclass(frozen=True)
class MountainCarContinuous:
    """The same with a throttle; reward 100 at position 0.45, less 0.1·throttle² a step."""

    max_episode_steps: int = 999

    feature_names: ClassVar[tuple[str, ...]] = ("position", "velocity")
    action_names: ClassVar[tuple[str, ...]] = ("throttle",)
    goal: ClassVar[float] = 0.45
    force: ClassVar[float] = 0.0015

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Position, velocity."""
        return _observation_space()

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        """Throttle, from full left to full right."""
        return gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, key: PRNGKeyArray) -> tuple[MountainCarState, Float[Array, " 2"]]:
        """Start at rest, uniform in [−0.6, −0.4]."""
        return _reset(key)

    def step(
        self, key: PRNGKeyArray, state: MountainCarState, action: Float[Array, " 1"]
    ) -> tuple[MountainCarState, Step]:
        """One step of the clock; the throttle is clipped for the motor, not for its cost."""
        throttle = action[0]
        physics = _drive(state.physics, self.force * jnp.clip(throttle, -1, 1))
        terminated = _at_goal(physics, self.goal)
        reward = jnp.where(terminated, jnp.float32(100), jnp.float32(0)) - 0.1 * throttle**2
        time = state.time + 1
        return MountainCarState(physics, time), Step(
            physics, reward, terminated, time >= self.max_episode_steps
        )


def _observation_space() -> gymnasium.spaces.Box:
    left, right = POSITION_LIMITS
    low, high = np.array([[left, -SPEED_LIMIT], [right, SPEED_LIMIT]], np.float32)
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def _reset(key: PRNGKeyArray) -> tuple[MountainCarState, Float[Array, " 2"]]:
    position = jax.random.uniform(key, (), jnp.float32, minval=START[0], maxval=START[1])
    physics = jnp.stack([position, jnp.zeros_like(position)])
    return MountainCarState(physics, jnp.int32(0)), physics


def _drive(physics: Float[Array, " 2"], push: Float[Array, ""]) -> Float[Array, " 2"]:
    """Add the motor's push and the slope's pull; the left wall stops the car, the right end holds it."""
    position, velocity = physics
    velocity = jnp.clip(velocity + push - GRAVITY * jnp.cos(3 * position), -SPEED_LIMIT, SPEED_LIMIT)
    position = jnp.clip(position + velocity, *POSITION_LIMITS)
    velocity = jnp.where(position == POSITION_LIMITS[0], jnp.maximum(velocity, 0), velocity)
    return jnp.stack([position, velocity])


def _at_goal(physics: Float[Array, " 2"], goal: float) -> Array:
    position, velocity = physics
    return (position >= goal) & (velocity >= 0)
