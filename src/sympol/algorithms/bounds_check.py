"""An environment promises bounds on what it returns; whoever breaks them is told, and not believed."""

from __future__ import annotations

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int

from ..types import Transition
from .init import Bounded
from .state import TrainState


class OutsideBounds(UserWarning):
    """An environment returned observations outside its own observation space."""


def watch_bounds(
    bounds: Bounded, state: TrainState, rollout: Transition, num_chunks: Int[Array, ""]
) -> TrainState:
    """Note which features of a (scaled) rollout leave the bounds of the space."""
    ends: Any = (np.asarray(bounds.low, np.float32), np.asarray(bounds.high, np.float32))
    low, high = map(state.normalizer, ends)

    def one_chunk(i: Int[Array, ""], outside: Array) -> Array:
        for seen in (rollout.observation[i], rollout.last_observation[i]):
            x = seen.reshape(-1, seen.shape[-1])
            outside |= jnp.stack([jnp.min(x, axis=0) < low, jnp.max(x, axis=0) > high])
        return outside

    return state._replace(outside=jax.lax.fori_loop(0, num_chunks, one_chunk, state.outside))


def kept_bounds(bounds: Bounded, state: TrainState) -> tuple[np.ndarray, np.ndarray]:
    """The bounds that were not broken; infinite in place of the others."""
    below, above = np.asarray(state.outside)
    return np.where(below, -np.inf, bounds.low), np.where(above, np.inf, bounds.high)


def warn_of_bounds(env_name: str, feature_names: tuple[str, ...], state: TrainState) -> bool:
    """Warn if bounds were broken; say whether there was anything to warn of."""
    below, above = np.asarray(state.outside)
    names = [repr(feature_names[feature]) for feature in np.flatnonzero(below | above)]
    if names:
        warnings.warn(
            f"{env_name} returned observations outside its observation space, in {', '.join(names)}; these bounds "
            "are not used for pruning. With a correct space the tree may be smaller.",
            OutsideBounds,
            stacklevel=4,
        )
    return bool(names)
