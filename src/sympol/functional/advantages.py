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
    """Compute advantages ``A_t = δ_t + γλ(1 − done_t)·A_{t+1}``, ``δ_t = r_t + γ(1 − done_t)·V_{t+1} − V_t``.

    A long rollout can be computed in pieces, from its end.

    Args:
        reward: The rewards; the value at a time limit has been added before (`fold_bootstrap`).
        value: The values of the observations.
        done: Whether each step ends an episode.
        next_value: The value of the observation after the last step.
        next_advantage: The advantage of the step after the last one.
        gamma: The discount factor.
        gae_lambda: The decay λ of generalised advantage estimation.

    Returns:
        The advantages.
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
    """Add ``γ·V(last observation)`` to the rewards of steps at which an episode was only truncated.

    Args:
        reward: The rewards.
        truncated: Whether each step truncates its episode.
        terminated: Whether each step terminates its episode.
        last_value: The value of the observation after each step.
        gamma: The discount factor.

    Returns:
        The rewards.
    """
    return reward + jnp.where(truncated & ~terminated, gamma * last_value, 0.0)
