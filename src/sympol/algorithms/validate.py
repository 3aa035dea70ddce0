"""Validation inside the compiled program; what is reported is measured on Gymnasium (`sympol.evaluate`)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from ..envs.env import MAX_EPISODE_STEPS, Env
from ..policies.distributions import Distribution
from .config import Config

SHORTEST_CUT = 1_000
"""No episode is cut before that many steps, however short the training."""


def validation_limit(declared: int | None, config: Config, num_episodes: int) -> int:
    """Steps after which validation cuts an episode.

    This is the time limit that an environment declares. Where it declares none, a validation of ``num_episodes`` that
    never end takes as many steps as the training between two validations, but no episode is cut before `SHORTEST_CUT`
    steps or goes on after `MAX_EPISODE_STEPS`.
    """
    share = config.total_timesteps // config.num_evals // num_episodes
    return declared or min(max(share, SHORTEST_CUT), MAX_EPISODE_STEPS)


def limit_in(env: Env, config: Config) -> int:
    """`validation_limit` of an environment written in JAX."""
    return validation_limit(getattr(env, "max_episode_steps", None), config, config.num_eval_episodes)


def validate(
    env: Env,
    distribution: Distribution,
    policy: Callable[[Float[Array, "batch features"]], Float[Array, "batch outputs"]],
    normalize: Callable[[Array], Array],
    key: PRNGKeyArray,
    num_episodes: int,
    limit: int,
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """Mean undiscounted return of the deterministic policy over a number of episodes.

    Episodes are cut after ``limit`` steps; also returned is whether one was.
    """
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
    *_, done, total = jax.lax.while_loop(running, one_step, start)
    return jnp.mean(total), ~jnp.all(done)
