"""Angles on the circle."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float


def wrap_angle(angle: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Bring radians into [−π, π] by whole turns.

    One rounding in place of a loop. Ties go to the even turn, so that ±π stay where they are.
    """
    return angle - 2 * math.pi * jnp.round(angle / (2 * math.pi))
