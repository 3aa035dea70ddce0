"""Acrobot-v1: Sutton's two-link robot with a motor at its elbow, as in Sutton and Barto's book."""

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

GRAVITY = 9.8  # m/s²
MASS = 1.0  # kg, each link
LENGTH = 1.0  # m, each link
CENTER = 0.5  # m, from a link's upper joint to its centre of mass
INERTIA = 1.0  # kg·m², each link about its centre of mass
TORQUE = 1.0  # N·m
TIME_STEP = 0.2  # s
SPEED_LIMITS = (4 * math.pi, 9 * math.pi)  # rad/s, shoulder and elbow
GOAL_HEIGHT = 1.0  # m above the shoulder, for the free end


class AcrobotState(NamedTuple):
    """Shoulder and elbow angle (rad, 0 hangs straight), their angular velocities (rad/s); steps taken."""

    physics: Float[Array, " 4"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class Acrobot:
    """Swing the free end above the line; reward −1 a step and 0 for the last, the end at the line."""

    max_episode_steps: int = 500

    feature_names: ClassVar[tuple[str, ...]] = (
        "cos shoulder angle",
        "sin shoulder angle",
        "cos elbow angle",
        "sin elbow angle",
        "shoulder angular velocity (rad/s)",
        "elbow angular velocity (rad/s)",
    )
    action_names: ClassVar[tuple[str, ...]] = ("torque -1 N·m", "no torque", "torque +1 N·m")

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Cosine and sine of both angles, then both angular velocities."""
        high = np.array([1, 1, 1, 1, *SPEED_LIMITS], np.float32)
        return gymnasium.spaces.Box(-high, high, dtype=np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        """Torque on the elbow: negative, none, positive."""
        return gymnasium.spaces.Discrete(3)

    def reset(self, key: PRNGKeyArray) -> tuple[AcrobotState, Float[Array, " 6"]]:
        """Start near hanging still: each quantity uniform in ±0.1."""
        physics = jax.random.uniform(key, (4,), jnp.float32, minval=-0.1, maxval=0.1)
        return AcrobotState(physics, jnp.int32(0)), _observe(physics)

    def step(
        self, key: PRNGKeyArray, state: AcrobotState, action: Int[Array, ""]
    ) -> tuple[AcrobotState, Step]:
        """One Runge–Kutta step of 0.2 s under a constant torque."""
        torque = TORQUE * (action.astype(jnp.float32) - 1)
        theta1, theta2, omega1, omega2 = _runge_kutta_4(state.physics, torque)
        physics = jnp.stack(
            [
                wrap_angle(theta1),
                wrap_angle(theta2),
                jnp.clip(omega1, -SPEED_LIMITS[0], SPEED_LIMITS[0]),
                jnp.clip(omega2, -SPEED_LIMITS[1], SPEED_LIMITS[1]),
            ]
        )
        observation = _observe(physics)
        cos1, sin1, cos2, sin2, _, _ = observation
        height = -LENGTH * cos1 - LENGTH * (cos1 * cos2 - sin1 * sin2)
        terminated = height > GOAL_HEIGHT
        time = state.time + 1
        reward = jnp.where(terminated, jnp.float32(0), jnp.float32(-1))
        return AcrobotState(physics, time), Step(
            observation, reward, terminated, time >= self.max_episode_steps
        )


def _observe(physics: Float[Array, " 4"]) -> Float[Array, " 6"]:
    (cos1, cos2), (sin1, sin2) = jnp.cos(physics[:2]), jnp.sin(physics[:2])
    return jnp.stack([cos1, sin1, cos2, sin2, physics[2], physics[3]])


def _derivative(physics: Float[Array, " 4"], torque: Float[Array, ""]) -> Float[Array, " 4"]:
    """Velocities and accelerations of the two joints (Sutton and Barto's equations of motion)."""
    theta1, theta2, omega1, omega2 = physics
    cos2, sin2 = jnp.cos(theta2), jnp.sin(theta2)
    coupling = MASS * LENGTH * CENTER
    d1 = MASS * (2 * CENTER**2 + LENGTH**2) + 2 * INERTIA + 2 * coupling * cos2
    d2 = MASS * CENTER**2 + INERTIA + coupling * cos2
    phi2 = MASS * CENTER * GRAVITY * jnp.sin(theta1 + theta2)
    phi1 = (
        phi2
        + MASS * (CENTER + LENGTH) * GRAVITY * jnp.sin(theta1)
        - coupling * omega2 * (omega2 + 2 * omega1) * sin2
    )
    alpha2 = (torque + d2 / d1 * phi1 - coupling * omega1**2 * sin2 - phi2) / (
        MASS * CENTER**2 + INERTIA - d2**2 / d1
    )
    alpha1 = -(d2 * alpha2 + phi1) / d1
    return jnp.stack([omega1, omega2, alpha1, alpha2])


def _runge_kutta_4(physics: Float[Array, " 4"], torque: Float[Array, ""]) -> Float[Array, " 4"]:
    k1 = _derivative(physics, torque)
    k2 = _derivative(physics + TIME_STEP / 2 * k1, torque)
    k3 = _derivative(physics + TIME_STEP / 2 * k2, torque)
    k4 = _derivative(physics + TIME_STEP * k3, torque)
    return physics + TIME_STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
