"""Pendulum-v1: swing a rod upright with a weak motor and hold it there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ...types import Step
from .angles import wrap_angle

GRAVITY = 10.0  # m/s²
MASS = 1.0  # kg
LENGTH = 1.0  # m, a uniform rod turning about its end
TORQUE_LIMIT = 2.0  # N·m
SPEED_LIMIT = 8.0  # rad/s
TIME_STEP = 0.05  # s


class PendulumState(NamedTuple):
    """Angle (rad, 0 is upright, within ±π) and angular velocity (rad/s); steps taken."""

    physics: Float[Array, " 2"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class Pendulum:
    """Hold a rod upright; reward −(angle² + 0.1·velocity² + 0.001·torque²), the end only by the clock."""

    max_episode_steps: int = 200

    feature_names: ClassVar[tuple[str, ...]] = ("cos angle", "sin angle", "angular velocity (rad/s)")
    action_names: ClassVar[tuple[str, ...]] = ("torque (N·m)",)

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Cosine and sine of the angle, angular velocity."""
        high = np.array([1, 1, SPEED_LIMIT], np.float32)
        return gymnasium.spaces.Box(-high, high, dtype=np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        """Torque, counter-clockwise positive."""
        return gymnasium.spaces.Box(-TORQUE_LIMIT, TORQUE_LIMIT, (1,), np.float32)

    def reset(self, key: PRNGKeyArray) -> tuple[PendulumState, Float[Array, " 3"]]:
        """Start anywhere on the circle, at up to 1 rad/s either way."""
        angle, velocity = jax.random.uniform(key, (2,), jnp.float32, minval=-1, maxval=1)
        physics = jnp.stack([math.pi * angle, velocity])
        return PendulumState(physics, jnp.int32(0)), _observe(physics)

    def step(
        self, key: PRNGKeyArray, state: PendulumState, action: Float[Array, " 1"]
    ) -> tuple[PendulumState, Step]:
        """One semi-implicit Euler step of 0.05 s; the cost is of the state before it.

        The angle is kept within ±π where Gymnasium lets it run: only its place on the circle can be seen,
        and float32 keeps small numbers more exactly than large ones.
        """
        angle, velocity = state.physics
        torque = jnp.clip(action[0], -TORQUE_LIMIT, TORQUE_LIMIT)
        reward = -(angle**2 + 0.1 * velocity**2 + 0.001 * torque**2)
        acceleration = 1.5 * GRAVITY / LENGTH * jnp.sin(angle) + 3 / (MASS * LENGTH**2) * torque
        velocity = jnp.clip(velocity + TIME_STEP * acceleration, -SPEED_LIMIT, SPEED_LIMIT)
        physics = jnp.stack([wrap_angle(angle + TIME_STEP * velocity), velocity])
        time = state.time + 1
        return PendulumState(physics, time), Step(
            _observe(physics), reward, jnp.bool_(False), time >= self.max_episode_steps
        )


def _observe(physics: Float[Array, " 2"]) -> Float[Array, " 3"]:
    angle, velocity = physics
    return jnp.stack([jnp.cos(angle), jnp.sin(angle), velocity])
