"""New episodes for the environments in which one has just ended."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Int

from ..envs.env import Env
from .state import tree_where

EXPENSIVE = 1e6
"""A reset that moves as many bytes, by XLA's estimate, is expensive: craftax's moves 3·10⁷, jumanji's Snake 4·10⁴, our
own environments at most 10⁴."""
MOST_BLOCKS = 16
"""The largest number of blocks, one after the other, in which all environments are reset."""


def block_size(env: Env, num_envs: int) -> int:
    """Return how many environments are reset at once.

    Args:
        env: The environment.
        num_envs: The number of copies, E.

    Returns:
        E where a reset is so cheap that choosing the environments would cost more, else at most E / `MOST_BLOCKS`,
        rounded up.
    """
    cost = jax.jit(env.reset).lower(jax.eval_shape(lambda: jax.random.key(0))).cost_analysis()
    is_expensive = isinstance(cost, dict) and cost.get("bytes accessed", 0) >= EXPENSIVE
    return -(-num_envs // MOST_BLOCKS) if is_expensive else num_envs


def restart(env: Env, done: Bool[Array, " envs"], keys: Array, moved_on: Any, block: int) -> Any:
    """Reset the environments whose episodes have ended, a block at a time.

    Args:
        env: The environment.
        done: Which environments to reset.
        keys: A key for each environment, used where it is reset.
        moved_on: The state and observation of each environment after its step.
        block: The number of environments that are reset at once; if it is that of all of them, all are reset, and the
            results thrown away where no episode has ended.

    Returns:
        The states and observations to continue from.
    """
    num_envs = len(done)
    if block >= num_envs:
        fresh = lambda: tree_where(done, jax.vmap(env.reset)(keys), moved_on)  # noqa: E731
        return jax.lax.cond(jnp.any(done), fresh, lambda: moved_on)
    count = jnp.sum(done)
    ended = jnp.nonzero(done, size=num_envs + -num_envs % block, fill_value=num_envs)[0]

    def one_block(carry: tuple[Int[Array, ""], Any]) -> tuple[Int[Array, ""], Any]:
        start, current = carry
        chosen = jax.lax.dynamic_slice(ended, (start,), (block,))  # num_envs where there are no more
        fresh = jax.vmap(env.reset)(keys.at[chosen].get(mode="clip"))
        return start + block, jax.tree.map(lambda a, b: a.at[chosen].set(b, mode="drop"), current, fresh)

    return jax.lax.while_loop(lambda carry: carry[0] < count, one_block, (jnp.int32(0), moved_on))[1]
