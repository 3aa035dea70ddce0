"""Distributions over actions, which give the numbers in a leaf their meaning.

Each maps the policy's ``outputs [..., num_outputs]`` (and a state-independent ``log_std`` for continuous
actions) to actions. Sampling takes its noise from outside, so that a whole rollout draws it in one call.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..types import Action
from .action_units import units_and_centers

HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


class Distribution(Protocol):
    """The distribution over the actions of one space.

    Outputs are ``[..., num_outputs]``; ``log_std`` is empty for discrete actions.
    """

    @property
    def num_outputs(self) -> int:
        """The number of outputs of a leaf."""
        ...

    @property
    def num_std(self) -> int:
        """The number of log standard deviations; none for discrete actions."""
        ...

    def noise(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "..."]:
        """Draw the noise that `sample` needs.

        Args:
            key: The source of randomness.
            shape: The shape of the batch of actions.

        Returns:
            The noise.
        """
        ...

    def sample(self, outputs: Array, log_std: Array, noise: Array) -> Action:
        """Sample actions.

        Args:
            outputs: The outputs of the policy.
            log_std: The log standard deviations.
            noise: The noise, of `noise`.

        Returns:
            One action for each output.
        """
        ...

    def mode(self, outputs: Array) -> Action:
        """Return the most probable actions, which the deterministic policy takes.

        Args:
            outputs: The outputs of the policy.

        Returns:
            One action for each output.
        """
        ...

    def log_prob(self, outputs: Array, log_std: Array, action: Action) -> Array:
        """Compute the log-probability, or its density, of actions as sampled, before any clipping.

        Args:
            outputs: The outputs of the policy.
            log_std: The log standard deviations.
            action: The actions.

        Returns:
            One number for each action.
        """
        ...

    def entropy(self, outputs: Array, log_std: Array) -> Array:
        """Compute the entropy.

        Args:
            outputs: The outputs of the policy.
            log_std: The log standard deviations.

        Returns:
            The entropy in nats, one for each output.
        """
        ...

    def to_env(self, action: Action) -> Action:
        """Convert actions to those that the environment takes.

        Args:
            action: The actions as sampled.

        Returns:
            The actions, clipped to the space and in its shape.
        """
        ...


def _select(values: Array, index: Array) -> Array:
    """Return ``values[..., index]`` without a gather, because the axis is short."""
    choices = jax.lax.broadcasted_iota(jnp.int32, values.shape, values.ndim - 1)
    return jnp.sum(jnp.where(choices == index[..., None], values, 0), axis=-1)


def _like(vector: Array, batch: Array) -> Array:
    """Add leading axes to a vector, to broadcast it over a batch of such vectors."""
    return vector.reshape((1,) * (batch.ndim - 1) + vector.shape)


@dataclass(frozen=True)
class Categorical:
    """``Discrete(n)``: outputs are logits, actions int32 in [0, n)."""

    n: int

    @property
    def num_outputs(self) -> int:
        """One logit an action."""
        return self.n

    @property
    def num_std(self) -> int:
        """None."""
        return 0

    def noise(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "..."]:
        """Gumbel noise."""
        return jax.random.gumbel(key, (*shape, self.n))

    def sample(self, outputs: Array, log_std: Array, noise: Array) -> Action:
        """The Gumbel-max trick."""
        return jnp.argmax(outputs + noise, axis=-1).astype(jnp.int32)

    def mode(self, outputs: Array) -> Action:
        """The largest logit; of equal ones the first."""
        return jnp.argmax(outputs, axis=-1).astype(jnp.int32)

    def log_prob(self, outputs: Array, log_std: Array, action: Action) -> Array:
        """``logit[a] − logsumexp(logits)``."""
        return _select(jax.nn.log_softmax(outputs), action)

    def entropy(self, outputs: Array, log_std: Array) -> Array:
        """``−Σ p log p``."""
        log_p = jax.nn.log_softmax(outputs)
        return -jnp.sum(jnp.exp(log_p) * log_p, axis=-1)

    def to_env(self, action: Action) -> Action:
        """Return the action unchanged."""
        return action


@dataclass(frozen=True)
class MultiCategorical:
    """``MultiDiscrete(nvec)``: the logits of all components one after the other, actions int32 [..., k]."""

    nvec: tuple[int, ...]

    @property
    def num_outputs(self) -> int:
        """One logit for each choice of each component."""
        return sum(self.nvec)

    @property
    def num_std(self) -> int:
        """None."""
        return 0

    def _parts(self, outputs: Array) -> list[tuple[Categorical, Array]]:
        pieces = jnp.split(outputs, np.cumsum(self.nvec)[:-1].tolist(), axis=-1)
        return [(Categorical(n), piece) for n, piece in zip(self.nvec, pieces, strict=True)]

    def noise(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "..."]:
        """Gumbel noise."""
        return jax.random.gumbel(key, (*shape, self.num_outputs))

    def sample(self, outputs: Array, log_std: Array, noise: Array) -> Action:
        """The Gumbel-max trick, component by component."""
        return self.mode(outputs + noise)

    def mode(self, outputs: Array) -> Action:
        """The largest logit of each component."""
        return jnp.stack([part.mode(logits) for part, logits in self._parts(outputs)], axis=-1)

    def log_prob(self, outputs: Array, log_std: Array, action: Action) -> Array:
        """Sum over the components: they are independent given the leaf."""
        parts = self._parts(outputs)
        return sum(
            (part.log_prob(logits, log_std, action[..., i]) for i, (part, logits) in enumerate(parts)),
            start=jnp.zeros(outputs.shape[:-1]),
        )

    def entropy(self, outputs: Array, log_std: Array) -> Array:
        """Sum over the components."""
        parts = self._parts(outputs)
        return sum(
            (part.entropy(logits, log_std) for part, logits in parts), start=jnp.zeros(outputs.shape[:-1])
        )

    def to_env(self, action: Action) -> Action:
        """Return the action unchanged."""
        return action


@dataclass(frozen=True)
class DiagonalGaussian:
    """``Box``: outputs are means, one standard deviation an action dimension whatever the state.

    Attributes:
        low: The lower bounds, in the environment's units.
        high: The upper bounds.
        shape: The shape of an action.
        units: The unit of each dimension in which actions are sampled (`sympol.policies.action_units`); empty for 1.
        centers: The middle of the range of each dimension, in that unit; empty for 0.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    shape: tuple[int, ...]
    units: tuple[float, ...] = ()
    centers: tuple[float, ...] = ()

    @property
    def num_outputs(self) -> int:
        """One mean a dimension."""
        return len(self.low)

    @property
    def num_std(self) -> int:
        """One a dimension."""
        return len(self.low)

    def noise(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> Float[Array, "..."]:
        """Standard normal noise."""
        return jax.random.normal(key, (*shape, self.num_outputs))

    def sample(self, outputs: Array, log_std: Array, noise: Array) -> Action:
        """``mean + std · noise``."""
        return outputs + _like(jnp.exp(log_std), outputs) * noise

    def mode(self, outputs: Array) -> Action:
        """The mean."""
        return outputs

    def log_prob(self, outputs: Array, log_std: Array, action: Action) -> Array:
        """Log-density, summed over the dimensions."""
        z = (action - outputs) * _like(jnp.exp(-log_std), outputs)
        return -jnp.sum(0.5 * z**2, axis=-1) - jnp.sum(log_std + HALF_LOG_2PI)

    def entropy(self, outputs: Array, log_std: Array) -> Array:
        """``Σ log σ + ½ log 2πe``: the same in every state."""
        return jnp.broadcast_to(jnp.sum(log_std + HALF_LOG_2PI + 0.5), outputs.shape[:-1])

    def to_env(self, action: Action) -> Action:
        """In the environment's units, clipped to the bounds, in the space's shape."""
        low, high = (_like(jnp.asarray(b, jnp.float32), action) for b in (self.low, self.high))
        if any(unit != 1 for unit in self.units):
            action = action * _like(jnp.asarray(self.units, jnp.float32), action)
        clipped = jnp.clip(action, low, high)
        return clipped.reshape(action.shape[:-1] + self.shape)


def distribution_of(space: gymnasium.Space, *, scaled: bool = False) -> Distribution:
    """Return the distribution over the actions of a Gymnasium space.

    Args:
        space: The space.
        scaled: Whether continuous actions are sampled in units of about half their range instead of the
            environment's.

    Returns:
        The distribution.

    Raises:
        TypeError: The space is not supported.
    """
    match space:
        case gymnasium.spaces.Discrete():
            return Categorical(int(space.n))
        case gymnasium.spaces.MultiDiscrete():
            return MultiCategorical(tuple(int(n) for n in space.nvec))
        case gymnasium.spaces.Box():
            low, high = (
                tuple(bound.astype(np.float32).ravel().tolist()) for bound in (space.low, space.high)
            )
            units, centers = units_and_centers(space, scaled=scaled)
            return DiagonalGaussian(low, high, space.shape, tuple(units.tolist()), tuple(centers.tolist()))
        case _:
            raise TypeError(f"no distribution over {space}; actions are Discrete, MultiDiscrete or Box")
