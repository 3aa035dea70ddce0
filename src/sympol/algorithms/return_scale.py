"""The scale on which a critic learns returns (PopArt: van Hasselt et al., 2016, "Learning values across many orders of
magnitude").

A critic that starts near 0 needs thousands of steps to predict a return of -4,000, and its errors then are as large.
So it predicts ``(return - mean) / std`` with the mean and the standard deviation of recent returns. When these move,
the last layer moves with them, such that no prediction changes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from ..policies.mlp import MLP

SLOWEST = 0.1
"""The weight of the newest rollout in the mean and the standard deviation, once there have been ten."""

SMALLEST_STD = 0.01
"""The least standard deviation, as a part of the largest reward so far."""


class ReturnScale(NamedTuple):
    """The mean and the spread of recent returns.

    Attributes:
        mean: The mean.
        square: The mean square.
        largest: The largest magnitude of a reward so far.
        num_rollouts: The number of rollouts seen.
    """

    mean: Float[Array, ""]
    square: Float[Array, ""]
    largest: Float[Array, ""]
    num_rollouts: Int[Array, ""]

    @staticmethod
    def zeros() -> ReturnScale:
        """Return the scale before the first rollout, which changes nothing."""
        return ReturnScale(jnp.float32(0), jnp.float32(0), jnp.float32(0), jnp.int32(0))

    @property
    def std(self) -> Float[Array, ""]:
        """The standard deviation to divide by; 1 as long as every reward was 0."""
        spread = jnp.sqrt(jnp.maximum(self.square - self.mean**2, 0))
        return jnp.where(self.largest > 0, jnp.maximum(spread, SMALLEST_STD * self.largest), 1.0)

    def to_value(self, output: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Return the values that outputs of the critic mean."""
        return self.mean + self.std * output

    def to_output(self, value: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Return the outputs of the critic that mean values."""
        return (value - self.mean) / self.std

    def after(
        self, mean: Float[Array, ""], square: Float[Array, ""], largest: Float[Array, ""]
    ) -> ReturnScale:
        """Return the scale after one more rollout.

        Args:
            mean: The mean of its returns.
            square: Their mean square.
            largest: The largest magnitude of its rewards.

        Returns:
            The moved scale.
        """
        weight = jnp.maximum(1.0 / (self.num_rollouts.astype(jnp.float32) + 1), SLOWEST)
        return ReturnScale(
            self.mean + weight * (mean - self.mean),
            self.square + weight * (square - self.square),
            jnp.maximum(self.largest, largest),
            self.num_rollouts + 1,
        )


def rescale_critic(critic: Any, before: ReturnScale, after: ReturnScale) -> Any:
    """Return the critic whose predictions are the same on another scale.

    Args:
        critic: An `MLP`, a `Tree` or a `SoftTree` with one output.
        before: The scale of its outputs.
        after: The scale that they are to have.

    Returns:
        The critic with another last layer, or other leaves.
    """
    factor = before.std / after.std
    offset = (before.mean - after.mean) / after.std
    if isinstance(critic, MLP):
        last = (critic.weights[-1] * factor, critic.biases[-1] * factor + offset)
        return eqx.tree_at(lambda c: (c.weights[-1], c.biases[-1]), critic, last)
    return eqx.tree_at(lambda c: c.leaf_values, critic, critic.leaf_values * factor + offset)
