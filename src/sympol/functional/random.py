"""Random numbers in few calls."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import PRNGKeyArray


def normals(key: PRNGKeyArray, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Draw several standard normal arrays by one call.

    Each call of `jax.random` is compiled on its own, which takes about a tenth of a second.

    Args:
        key: The source of randomness.
        shapes: The shapes.

    Returns:
        An array of each shape.
    """
    ends = [0]
    for shape in shapes:
        ends.append(ends[-1] + math.prod(shape))
    pieces = jnp.split(jax.random.normal(key, (ends[-1],)), ends[1:-1])
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]
