"""The scale of the features, and the bounds that an environment declares for them.

The scale is fitted to the first chunk of experience and frozen. Bounds are believed until an observation breaks them:
then the user is warned once, and they are no longer used for pruning.
"""

from __future__ import annotations

import warnings
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Int

from ..envs.spaces import LARGEST, UNBOUNDED
from ..functional.spread import center_and_scale
from ..types import Transition
from .config import Config
from .state import Normalizer, TrainState


class Bounded(Protocol):
    """Anything that knows the bounds of a flat observation, such as a `gymnasium.spaces.Box`."""

    @property
    def low(self) -> np.ndarray:
        """The lowest value of each feature."""
        ...

    @property
    def high(self) -> np.ndarray:
        """The highest value of each feature."""
        ...


class OutsideBounds(UserWarning):
    """An environment returned observations outside its own observation space."""


def initial_normalizer(bounds: Bounded, config: Config) -> tuple[Normalizer, np.ndarray]:
    """Return the scale that needs no data.

    Args:
        bounds: The bounds of the features.
        config: Whether to scale at all, and whether to trust these bounds.

    Returns:
        The normalizer, which maps features with trusted bounds to [−1, 1] and leaves the others as they are; and
        whether it is final for each feature ``[features]``. The others are fitted by `refit_normalizer`.
    """
    low, high = (np.asarray(bound, np.float32).ravel() for bound in (bounds.low, bounds.high))
    bounded = (np.abs(low) < UNBOUNDED) & (np.abs(high) < UNBOUNDED) & (high > low) & config.trust_bounds
    scaled = bounded & config.normalize_obs
    low, high = np.where(scaled, low, -1), np.where(scaled, high, 1)
    # constants of the program, in NumPy: making them JAX arrays here would compile two programs more
    affine: Any = ((low + high) / 2).astype(np.float32), (2 / (high - low)).astype(np.float32)
    return Normalizer(*affine), bounded | (not config.normalize_obs)


def refit_normalizer(normalizer: Normalizer, rollout: Transition, final: np.ndarray) -> Normalizer:
    """Fit the scale to the first chunk: mean 0 and standard deviation ½ for the features that vary.

    Args:
        normalizer: The scale so far, which stays for features that are final or constant.
        rollout: The rollout ``[chunks, steps, envs, ...]``.
        final: Which features have their scale already.

    Returns:
        The scale to freeze.
    """
    x = rollout.observation[0].reshape(-1, final.shape[0])
    moving, mean, scale = center_and_scale(x)
    fitted = ~final & moving
    return Normalizer(jnp.where(fitted, mean, normalizer.shift), jnp.where(fitted, scale, normalizer.scale))


def can_be_scaled(rollout: Transition) -> Bool[Array, " features"]:
    """Return for each feature whether all its values in the first chunk are finite and small enough to be scaled."""
    x = rollout.observation[0].reshape(-1, rollout.observation.shape[-1])
    return jnp.max(jnp.abs(x), axis=0) <= LARGEST


def watch_bounds(
    bounds: Bounded, state: TrainState, rollout: Transition, num_chunks: Int[Array, ""]
) -> TrainState:
    """Record which features of a rollout, scaled by the state's normalizer, leave the bounds of the space."""
    ends: Any = (np.asarray(bounds.low, np.float32), np.asarray(bounds.high, np.float32))
    low, high = map(state.normalizer, ends)

    def one_chunk(i: Int[Array, ""], outside: Array) -> Array:
        for seen in (rollout.observation[i], rollout.last_observation[i]):
            x = seen.reshape(-1, seen.shape[-1])
            outside |= jnp.stack([jnp.min(x, axis=0) < low, jnp.max(x, axis=0) > high])
        return outside

    return state._replace(outside=jax.lax.fori_loop(0, num_chunks, one_chunk, state.outside))


def unbroken_bounds(bounds: Bounded, state: TrainState) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper bounds that no observation has broken, infinite in place of the others."""
    below, above = np.asarray(state.outside)
    return np.where(below, -np.inf, bounds.low), np.where(above, np.inf, bounds.high)


def warn_of_bounds(env_name: str, feature_names: tuple[str, ...], state: TrainState) -> bool:
    """Warn if observations broke the bounds of their space, and return whether they did."""
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
