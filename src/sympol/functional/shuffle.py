"""Random permutations of the samples of a rollout that grows, without ever sorting more than one chunk."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Int, PRNGKeyArray


class Shuffle(NamedTuple):
    """A random permutation of ``2^k · chunk_size`` samples that never sorts more than one chunk.

    Sample ``i = c + 2^k·j`` goes to chunk ``(a·c + jump[j']) mod 2^k``, place ``j' = order[(j + turn[c]) mod
    chunk_size]``: for each c a bijection in j, for each j' a bijection in c, so a bijection.

    Attributes:
        order: The permutation of a chunk.
        turn: The rotation of each chunk.
        jump: The offset of each place.
        stride: The odd factor a.
    """

    order: Int[Array, " chunk_size"]
    turn: Int[Array, " max_chunks"]
    jump: Int[Array, " chunk_size"]
    stride: Int[Array, ""]

    @staticmethod
    def create(key: PRNGKeyArray, chunk_size: int, max_chunks: int) -> Shuffle:
        """Draw a permutation.

        Args:
            key: The source of randomness.
            chunk_size: The number of samples of a chunk.
            max_chunks: The largest number of chunks, a power of two.

        Returns:
            The permutation.
        """
        bits = jax.random.bits(key, (2 * chunk_size + max_chunks + 1,))
        order, turn, jump, stride = jnp.split(bits, [chunk_size, chunk_size + max_chunks, bits.size - 1])
        return Shuffle(
            jnp.argsort(order).astype(jnp.int32),
            (turn % chunk_size).astype(jnp.int32),
            (jump % max_chunks).astype(jnp.int32),
            (stride[0] % max_chunks).astype(jnp.int32) * 2 + 1,
        )

    def __call__(self, index: Int[Array, " batch"], stage: Int[Array, ""]) -> Int[Array, " batch"]:
        """Return the rows at which the samples ``index`` of a rollout of ``2^stage`` chunks lie."""
        chunk_size = self.order.shape[0]
        mask = (1 << stage) - 1
        chunk = index & mask
        place = self.order[((index >> stage) + self.turn[chunk]) % chunk_size]
        return ((self.stride * chunk + self.jump[place]) & mask) * chunk_size + place
