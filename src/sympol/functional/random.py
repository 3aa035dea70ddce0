"""Random numbers in few calls."""

from __future__ import annotations

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import PRNGKeyArray


def normals(key: PRNGKeyArray, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Standard normal arrays of the shapes given, out of one draw.

    Each call of `jax.random` is compiled on its own, at about a tenth of a second; this is one.
    """
    ends = [0]
    for shape in shapes:
        ends.append(ends[-1] + math.prod(shape))
    pieces = jnp.split(jax.random.normal(key, (ends[-1],)), ends[1:-1])
    return [piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)]
