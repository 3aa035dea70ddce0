"""CartPole-v1: Barto, Sutton and Anderson's cart and pole, as Gymnasium has it."""

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

GRAVITY = 9.8  # m/s²
MASS_POLE = 0.1  # kg
MASS_TOTAL = 1.0 + MASS_POLE  # kg
HALF_LENGTH = 0.5  # m, half of the pole
FORCE = 10.0  # N
TIME_STEP = 0.02  # s
ANGLE_LIMIT = 12 * 2 * math.pi / 360  # rad
POSITION_LIMIT = 2.4  # m


class CartPoleState(NamedTuple):
    """Position (m), velocity (m/s), angle (rad), angular velocity (rad/s); steps taken."""

    physics: Float[Array, " 4"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class CartPole:
    """Balance a pole on a cart; reward 1 a step, the end beyond 12 degrees or 2.4 m."""

    max_episode_steps: int = 500

    feature_names: ClassVar[tuple[str, ...]] = (
        "cart position (m)",
        "cart velocity (m/s)",
        "pole angle (rad)",
        "pole angular velocity (rad/s)",
    )
    action_names: ClassVar[tuple[str, ...]] = ("push left", "push right")

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Cart position, cart velocity, pole angle, pole angular velocity."""
        high = np.array([POSITION_LIMIT * 2, np.inf, ANGLE_LIMIT * 2, np.inf], np.float32)
        return gymnasium.spaces.Box(-high, high, dtype=np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        """Push to the left, push to the right."""
        return gymnasium.spaces.Discrete(2)

    def reset(self, key: PRNGKeyArray) -> tuple[CartPoleState, Float[Array, " 4"]]:
        """Start near upright: each quantity uniform in ±0.05."""
        physics = jax.random.uniform(key, (4,), jnp.float32, minval=-0.05, maxval=0.05)
        return CartPoleState(physics, jnp.int32(0)), physics

    def step(
        self, key: PRNGKeyArray, state: CartPoleState, action: Int[Array, ""]
    ) -> tuple[CartPoleState, Step]:
        """One explicit Euler step of 0.02 s."""
        x, x_dot, theta, theta_dot = state.physics
        force = jnp.where(action == 1, FORCE, -FORCE)
        cos, sin = jnp.cos(theta), jnp.sin(theta)
        push = (force + MASS_POLE * HALF_LENGTH * theta_dot**2 * sin) / MASS_TOTAL
        theta_acc = (GRAVITY * sin - cos * push) / (HALF_LENGTH * (4 / 3 - MASS_POLE * cos**2 / MASS_TOTAL))
        x_acc = push - MASS_POLE * HALF_LENGTH * theta_acc * cos / MASS_TOTAL
        physics = jnp.stack(
            [
                x + TIME_STEP * x_dot,
                x_dot + TIME_STEP * x_acc,
                theta + TIME_STEP * theta_dot,
                theta_dot + TIME_STEP * theta_acc,
            ]
        )
        time = state.time + 1
        terminated = (jnp.abs(physics[0]) > POSITION_LIMIT) | (jnp.abs(physics[2]) > ANGLE_LIMIT)
        truncated = time >= self.max_episode_steps
        return CartPoleState(physics, time), Step(physics, jnp.float32(1), terminated, truncated)
