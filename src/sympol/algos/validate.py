"""Validation inside the compiled program; what is reported is measured on Gymnasium (`sympol.evaluate`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..envs.env import MAX_EPISODE_STEPS, Env
from ..policies.distributions import Distribution


def validate(
    env: Env,
    distribution: Distribution,
    policy: Callable[[Float[Array, "batch features"]], Float[Array, "batch outputs"]],
    normalize: Callable[[Array], Array],
    key: PRNGKeyArray,
    num_episodes: int,
) -> Float[Array, ""]:
    """Mean undiscounted return of the deterministic policy over a number of episodes."""
    limit = getattr(env, "max_episode_steps", MAX_EPISODE_STEPS)
    reset_keys, step_keys = jax.random.split(key, (2, num_episodes))
    env_state, observation = jax.vmap(env.reset)(reset_keys)

    def running(carry: tuple[Int[Array, ""], Any, Array, Array, Array]) -> Array:
        time, _, _, done, _ = carry
        return ~jnp.all(done) & (time < limit)

    def one_step(carry: tuple[Int[Array, ""], Any, Array, Array, Array]) -> Any:
        time, env_state, observation, done, total = carry
        action = distribution.to_env(distribution.mode(policy(normalize(observation))))
        now = jax.vmap(lambda k: jax.random.fold_in(k, time))(step_keys)
        env_state, step = jax.vmap(env.step)(now, env_state, action)
        total = total + jnp.where(done, 0.0, step.reward)
        return time + 1, env_state, step.observation, done | step.terminated | step.truncated, total

    start = (jnp.int32(0), env_state, observation, jnp.zeros(num_episodes, bool), jnp.zeros(num_episodes))
    return jnp.mean(jax.lax.while_loop(running, one_step, start)[-1])
