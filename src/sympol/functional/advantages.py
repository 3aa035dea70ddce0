"""Generalised advantage estimation (Schulman et al., 2016)."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float


def gae(
    reward: Float[Array, "steps envs"],
    value: Float[Array, "steps envs"],
    done: Bool[Array, "steps envs"],
    next_value: Float[Array, " envs"],
    next_advantage: Float[Array, " envs"],
    *,
    gamma: Float[Array, ""] | float,
    gae_lambda: Float[Array, ""] | float,
) -> Float[Array, "steps envs"]:
    """Advantages ``A_t = δ_t + γλ(1 − done_t)·A_{t+1}``, ``δ_t = r_t + γ(1 − done_t)·V_{t+1} − V_t``.

    ``done`` marks every end of an episode; a value that is to be read at a time limit has been folded into the
    reward before (`fold_bootstrap`). ``next_value`` and ``next_advantage`` belong to the step after the last
    one, so that a long rollout can be worked off in pieces, from its end.
    """

    def backward(
        carry: tuple[Float[Array, " envs"], Float[Array, " envs"]], step: tuple[Array, Array, Array]
    ) -> tuple[tuple[Float[Array, " envs"], Float[Array, " envs"]], Float[Array, " envs"]]:
        value_after, advantage_after = carry
        r, v, end = step
        alive = jnp.where(end, 0.0, gamma)
        advantage = r + alive * value_after - v + alive * gae_lambda * advantage_after
        return (v, advantage), advantage

    start = (next_value, next_advantage)
    _, advantage = jax.lax.scan(backward, start, (reward, value, done), reverse=True, unroll=4)
    return advantage


def fold_bootstrap(
    reward: Float[Array, "*batch"],
    truncated: Bool[Array, "*batch"],
    terminated: Bool[Array, "*batch"],
    last_value: Float[Array, "*batch"],
    gamma: Float[Array, ""] | float,
) -> Float[Array, "*batch"]:
    """Add ``γ·V(last observation)`` to the reward of a step that only the clock ended."""
    return reward + jnp.where(truncated & ~terminated, gamma * last_value, 0.0)
