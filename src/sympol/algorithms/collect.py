"""Where experience comes from. The only fork of the program; everything after it is the same code."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Int, PRNGKeyArray

from ..envs.env import Env
from ..policies.distributions import Distribution
from ..types import Transition
from .config import Config
from .state import Episodes, TrainState, tree_where


def reset_envs(env: Env, key: PRNGKeyArray, num_envs: int) -> tuple[Any, Array]:
    """Start every environment."""
    return jax.vmap(env.reset)(jax.random.split(key, num_envs))


def empty_rollout(num_features: int, distribution: Distribution, config: Config) -> Transition:
    """A buffer for the longest rollout, ``[max_chunks, chunk_steps, num_envs, …]``."""
    outputs = jax.ShapeDtypeStruct((distribution.num_outputs,), jnp.float32)
    action = jax.eval_shape(distribution.mode, outputs)
    axes = (1 << config.max_stage, config.chunk_steps, config.num_envs)
    features = jnp.zeros((*axes, num_features))
    return Transition(
        observation=features,
        action=jnp.zeros((*axes, *action.shape), action.dtype),
        reward=jnp.zeros(axes),
        terminated=jnp.zeros(axes, bool),
        truncated=jnp.zeros(axes, bool),
        last_observation=features,
    )


def collect(
    env: Env,
    distribution: Distribution,
    state: TrainState,
    rollout: Transition,
    num_chunks: Int[Array, ""],
    key: PRNGKeyArray,
) -> tuple[TrainState, Transition]:
    """Fill the first ``num_chunks`` chunks of the buffer, inside the compiled program.

    Observations are stored scaled, as the networks see them. An environment that ended starts anew from a
    fresh key; its true last observation stays in the transition.
    """
    _, chunk_steps, num_envs = rollout.reward.shape
    policy = state.networks.actor.rollout()
    log_std = state.networks.actor.log_std
    normalize = state.normalizer

    def one_step(carry: tuple[Any, Array, Episodes], noise: Any) -> tuple[Any, Transition]:
        env_state, observation, episodes = carry
        action_noise, step_keys, fresh_state, fresh_observation = noise
        x = normalize(observation)
        action = distribution.sample(policy(x), log_std, action_noise)
        next_state, result = jax.vmap(env.step)(step_keys, env_state, distribution.to_env(action))
        done = result.terminated | result.truncated
        transition = Transition(
            x, action, result.reward, result.terminated, result.truncated, normalize(result.observation)
        )
        carry = (
            tree_where(done, fresh_state, next_state),
            tree_where(done, fresh_observation, result.observation),
            episodes.step(result.reward, done),
        )
        return carry, transition

    def one_chunk(i: Int[Array, ""], carry: Any) -> Any:
        running, buffer = carry
        # few large draws: each call of jax.random costs a tenth of a second of compiling
        act, world = jax.random.split(jax.random.fold_in(key, i))
        noise = distribution.noise(act, (chunk_steps, num_envs))
        step_keys, reset_keys = jax.random.split(world, (2, chunk_steps, num_envs))
        fresh = jax.vmap(jax.vmap(env.reset))(reset_keys)
        running, chunk = jax.lax.scan(one_step, running, (noise, step_keys, *fresh))
        buffer = jax.tree.map(lambda b, c: jax.lax.dynamic_update_index_in_dim(b, c, i, 0), buffer, chunk)
        return running, buffer

    running = (state.env_state, state.observation, state.episodes)
    (env_state, observation, episodes), rollout = jax.lax.fori_loop(
        0, num_chunks, one_chunk, (running, rollout)
    )
    return state._replace(env_state=env_state, observation=observation, episodes=episodes), rollout
