"""The samples of the last rollouts, out of which a tree grows (`sympol.algorithms.split_growth`).

A rollout of few samples tells a good split from noise only where it is worth much; smaller rollouts, on the other hand,
mean more optimizer steps. So splits are judged by several rollouts together. The policy has moved a little since the
older ones, as it has within the epochs of one.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int

from .config import Config

SAMPLES = 8192
"""Samples that are kept at most, unless rollouts are larger or grow."""
OCCASIONS = 24
"""A training of few steps keeps fewer, so that a tree that is trained for all of them has so many occasions to grow."""
MOST_NUMBERS = 2_000_000
"""Numbers that are kept at most beyond one rollout; every checkpoint holds them."""


class Evidence(NamedTuple):
    """Samples of the last rollouts.

    Attributes:
        x: Scaled observations.
        gradients: Gradients with respect to the outputs in them.
        num_rollouts: The number of rollouts seen.
    """

    x: Float[Array, "samples features"]
    gradients: Float[Array, "samples outputs"]
    num_rollouts: Int[Array, ""]

    @staticmethod
    def zeros(config: Config, num_features: int, num_outputs: int) -> Evidence | None:
        """Return the evidence before the first rollout, or None where only the newest rollout is to count."""
        number = num_kept(config, num_features + num_outputs)
        if number == 1:
            return None
        size = number * config.chunk_size
        return Evidence(jnp.zeros((size, num_features)), jnp.zeros((size, num_outputs)), jnp.int32(0))

    def with_rollout(self, x: Array, gradients: Array) -> Evidence:
        """Return the evidence with one rollout more, in the place of the oldest one."""
        size = x.shape[0]
        at = (self.num_rollouts % (self.x.shape[0] // size)) * size
        write = jax.lax.dynamic_update_slice_in_dim
        return Evidence(
            write(self.x, x, at, 0), write(self.gradients, gradients, at, 0), self.num_rollouts + 1
        )

    def is_new(self, size: int) -> Bool[Array, ""]:
        """Return whether nothing of this has been judged yet, where a rollout has ``size`` samples.

        Judged again and again, noise would be taken for a good split before long.
        """
        return self.num_rollouts % (self.x.shape[0] // size) == 0


def num_kept(config: Config, numbers: int) -> int:
    """Return the number of rollouts that are kept.

    Args:
        config: The configuration.
        numbers: The numbers of a sample.

    Returns:
        One where splits do not grow, or rollouts do.
    """
    if not config.grow_splits or config.max_stage:
        return 1
    most = min(SAMPLES, MOST_NUMBERS // numbers, config.total_timesteps // OCCASIONS)
    return max(1, most // config.chunk_size)
