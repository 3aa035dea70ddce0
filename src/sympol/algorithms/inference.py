"""Any actor outside of the compiled program: raw observations in, outputs out."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from ..compilation import require_no_fork
from ..policies.actor import Actor
from .state import Normalizer


@eqx.filter_jit
def _forward(actor: Actor, normalizer: Normalizer, x: Array | np.ndarray) -> Array:
    return actor.rollout()(normalizer(jnp.asarray(x)))


def outputs(actor: Actor, normalizer: Normalizer, x: np.ndarray) -> np.ndarray:
    """The actor's outputs ``[batch, outputs]`` for flat raw observations ``[batch, features]``.

    Batches are filled up to a power of two, so that few sizes ever compile.
    """
    require_no_fork()
    size = 1 << max(0, len(x) - 1).bit_length()
    filled = np.zeros((size, x.shape[1]), np.float32)
    filled[: len(x)] = x
    return np.asarray(_forward(actor, normalizer, filled))[: len(x)]
