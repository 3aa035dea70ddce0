"""How the rollout and the batch grow, and which samples make a batch.

A rollout is a whole number of *chunks*, each of one fixed shape, so that one compiled program serves every
stage: growing changes how many chunks a loop visits, never a shape.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Int, PRNGKeyArray

NUM_STAGES = 8


def stage(timestep: Any, total_timesteps: int, max_stage: int) -> Any:
    """The exponent k of ``n_k = n_init · 2^k``: eight equal stages, k = ⌈8(t+1)/(T+1)⌉ − 1.

    It stops growing at ``max_stage``. ``timestep`` is a Python int, or an int32 scalar inside a program.
    """
    if isinstance(timestep, int):
        return min((NUM_STAGES * timestep + NUM_STAGES - 1) // (total_timesteps + 1), max_stage)
    # the same in unsigned whole numbers, so that T may go up to 2^29
    k = (jnp.uint32(NUM_STAGES) * timestep.astype(jnp.uint32) + jnp.uint32(NUM_STAGES - 1)) // jnp.uint32(
        total_timesteps + 1
    )
    return jnp.minimum(k, jnp.uint32(max_stage)).astype(jnp.int32)


def num_minibatches(chunk_size: int, minibatch_size: int) -> int:
    """The largest number of equal minibatches of a chunk with at least ``minibatch_size`` samples each.

    Every sample is used exactly once an epoch, so the number divides the chunk; a chunk that is too small is one
    batch.
    """
    most = max(1, chunk_size // minibatch_size)
    return next(n for n in range(most, 0, -1) if chunk_size % n == 0)


class Shuffle(NamedTuple):
    """A random permutation of ``2^k · chunk_size`` samples that never sorts more than one chunk.

    Sample ``i = c + 2^k·j`` goes to chunk ``(a·c + jump[j']) mod 2^k``, place ``j' = order[(j + turn[c]) mod
    chunk_size]``: for each c a bijection in j, for each j' a bijection in c, so a bijection.
    """

    order: Int[Array, " chunk_size"]
    turn: Int[Array, " max_chunks"]
    jump: Int[Array, " chunk_size"]
    stride: Int[Array, ""]

    @staticmethod
    def create(key: PRNGKeyArray, chunk_size: int, max_chunks: int) -> Shuffle:
        """Draw a permutation; ``max_chunks`` is a power of two."""
        bits = jax.random.bits(key, (2 * chunk_size + max_chunks + 1,))
        order, turn, jump, stride = jnp.split(bits, [chunk_size, chunk_size + max_chunks, bits.size - 1])
        return Shuffle(
            jnp.argsort(order).astype(jnp.int32),
            (turn % chunk_size).astype(jnp.int32),
            (jump % max_chunks).astype(jnp.int32),
            (stride[0] % max_chunks).astype(jnp.int32) * 2 + 1,
        )

    def __call__(self, index: Int[Array, " batch"], stage: Int[Array, ""]) -> Int[Array, " batch"]:
        """Where the samples ``index`` of a rollout of ``2^stage`` chunks lie, as rows of that rollout."""
        chunk_size = self.order.shape[0]
        mask = (1 << stage) - 1
        chunk = index & mask
        place = self.order[((index >> stage) + self.turn[chunk]) % chunk_size]
        return ((self.stride * chunk + self.jump[place]) & mask) * chunk_size + place
