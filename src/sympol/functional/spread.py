"""Find out which features of an observation vary, each relative to its own values.

Training, warm starts and stable-baselines3's policy scale features by it.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

RESOLUTION = 2.0**-22
"""The resolution of float32, with a margin: where the range of values is a smaller part of them, it is rounding."""

LARGEST_SCALE = 2.0**126
"""The largest scale, because the inverse of a small spread may be no float32."""

_FAR = 256.0
"""The number of ranges away from zero beyond which a mean, computed as a sum, loses the range."""


def moves(low: Any, high: Any) -> Any:
    """Return whether features vary.

    Args:
        low: The lowest value of each feature, an array of NumPy or JAX.
        high: The highest value of each.

    Returns:
        True where the range is more than rounding.
    """
    spread = high - low
    return (spread > RESOLUTION * abs(low)) & (spread > RESOLUTION * abs(high))


def center_and_scale(
    x: Float[Array, "batch features"],
) -> tuple[Bool[Array, " features"], Float[Array, " features"], Float[Array, " features"]]:
    """Compute the centre and scale of features.

    Features of an unusual unit, or far from zero, are brought near one first, because in float32 their squares would
    vanish or overflow, and their sum would lose their differences.

    Args:
        x: Observations.

    Returns:
        Which features vary, the mean of each, and half the inverse of its standard deviation.
    """
    low, high = jnp.min(x, axis=0), jnp.max(x, axis=0)
    moving = moves(low, high)
    mean, std = jnp.mean(x, axis=0), jnp.std(x, axis=0)
    size, spread = jnp.maximum(jnp.abs(low), jnp.abs(high)), jnp.where(moving, high - low, 1)
    as_they_are = (std > 1e-6) & (size < 1e15) & (size < _FAR * spread)
    near_one = (x - x[:1]) / spread[None]
    mean = jnp.where(as_they_are, mean, x[0] + jnp.mean(near_one, axis=0) * spread)
    scale = jnp.where(
        as_they_are,
        0.5 / jnp.where(as_they_are, std, 1),
        jnp.minimum(0.5 / jnp.std(near_one, axis=0) / spread, np.float32(LARGEST_SCALE)),
    )
    return moving, mean, scale
