"""The training of a pure-JAX environment as one compiled program.

A *segment* is: iterate until a timestep is reached, then validate. The host calls the same compiled segment
again and again, and between two calls it saves, reports and may stop; where the calls are cut changes nothing
in what is computed. Every number that could change a shape is a trip count instead: nothing compiles twice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..envs.env import Env
from ..functional.schedules import stage
from ..policies.distributions import Distribution, distribution_of
from ..policies.mlp import MLP
from ..policies.tree import Tree
from ..types import Transition
from .collect import collect, empty_rollout, reset_envs
from .config import Hyperparameters, PPOConfig
from .evaluate import validate
from .optimizer import Networks, optimizer
from .ppo import learn
from .state import Episodes, Losses, Normalizer, TrainState, Validation

UNBOUNDED = 1e6
"""A bound beyond this says nothing about the scale of a feature."""

INIT, TRAIN, VALIDATE = range(3)
"""Purposes of the run's key: streams that never meet."""


def purpose_key(seed: Int[Array, ""], purpose: int) -> PRNGKeyArray:
    """The key of one purpose of the run with this seed."""
    return jax.random.fold_in(jax.random.key(seed), purpose)


def bounds_normalizer(low: np.ndarray, high: np.ndarray) -> tuple[Normalizer, np.ndarray]:
    """Features with bounds to [−1, 1], the others as they are; and which have bounds."""
    low, high = low.astype(np.float32), high.astype(np.float32)
    bounded = (np.abs(low) < UNBOUNDED) & (np.abs(high) < UNBOUNDED) & (high > low)
    low, high = np.where(bounded, low, -1), np.where(bounded, high, 1)
    shift, scale = ((low + high) / 2).astype(np.float32), (2 / (high - low)).astype(np.float32)
    return Normalizer(shift, scale), bounded  # pyright: ignore[reportArgumentType]


def identity_normalizer(num_features: int) -> Normalizer:
    """Leaves observations alone."""
    return Normalizer(jnp.zeros(num_features), jnp.ones(num_features))


def init_networks(
    config: PPOConfig,
    distribution: Distribution,
    num_features: int,
    hyper: Hyperparameters,
    key: PRNGKeyArray,
) -> Networks:
    """A random tree and a random critic."""
    actor_key, critic_key = jax.random.split(key)
    architecture: dict[str, Any] = dict(
        depth=config.depth, num_features=num_features, surrogate=config.surrogate
    )
    actor = Tree.create(
        actor_key,
        num_outputs=distribution.num_outputs,
        num_std=distribution.num_std,
        log_std=hyper.log_std_init,
        **architecture,
    )
    if config.critic == "tree":
        return Networks(actor, Tree.create(critic_key, num_outputs=1, **architecture))
    return Networks(actor, MLP.create(critic_key, (num_features, *config.critic_hidden, 1)))


def init_state(
    config: PPOConfig,
    distribution: Distribution,
    normalizer: Normalizer,
    hyper: Hyperparameters,
    seed: Int[Array, ""],
) -> TrainState:
    """Before the first step; the environments are not started yet."""
    num_features = normalizer.shift.shape[0]
    networks = init_networks(config, distribution, num_features, hyper, purpose_key(seed, INIT))
    return TrainState(
        networks=networks,
        opt_state=optimizer(hyper, jnp.float32(1), networks).init(networks),
        normalizer=Normalizer(jnp.asarray(normalizer.shift), jnp.asarray(normalizer.scale)),
        env_state=None,
        observation=None,
        key=purpose_key(seed, TRAIN),
        timestep=jnp.int32(0),
        iteration=jnp.int32(0),
        episodes=Episodes.zeros(config.num_envs),
        losses=Losses.zeros(),
        validation=Validation.create(networks.actor),
    )


def refit_normalizer(state: TrainState, rollout: Transition, bounded: np.ndarray) -> Normalizer:
    """From the first chunk: mean and deviation of the features that have no bounds."""
    x = rollout.observation[0].reshape(-1, bounded.shape[0])
    std = jnp.std(x, axis=0)
    usable = std > 1e-6
    shift = jnp.where(usable, jnp.mean(x, axis=0), 0.0)
    scale = jnp.where(usable, 1 / jnp.where(usable, 2 * std, 1.0), 1.0)
    return Normalizer(
        jnp.where(bounded, state.normalizer.shift, shift), jnp.where(bounded, state.normalizer.scale, scale)
    )


def make_segment(env: Env, config: PPOConfig) -> Callable[..., TrainState]:
    """``segment(hyper, seed, state, first, stop)``: train until ``stop`` timesteps, then validate.

    With ``first`` the state's values are ignored and a new training begins. A pure function: jit it, vmap it
    over ``hyper`` and ``seed``.
    """
    distribution = distribution_of(env.action_space)
    space = env.observation_space
    num_features = space.shape[0]
    if config.normalize_obs:
        normalizer, bounded = bounds_normalizer(space.low, space.high)
    else:
        normalizer, bounded = identity_normalizer(num_features), np.ones(num_features, bool)
    max_chunks = 1 << config.max_stage

    def begin(hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
        state = init_state(config, distribution, normalizer, hyper, seed)
        key, reset_key = jax.random.split(state.key)
        env_state, observation = reset_envs(env, reset_key, config.num_envs)
        return state._replace(key=key, env_state=env_state, observation=observation)

    def iteration(
        hyper: Hyperparameters, carry: tuple[TrainState, Transition]
    ) -> tuple[TrainState, Transition]:
        state, rollout = carry
        key, collect_key, learn_key = jax.random.split(state.key, 3)
        k = stage(state.timestep, config.total_timesteps, config.max_stage)
        state, rollout = collect(env, distribution, state, rollout, 1 << k, collect_key)
        next_x = state.normalizer(state.observation)

        def update(state: TrainState) -> TrainState:
            return learn(config, distribution, hyper, state, rollout, next_x, k, learn_key)

        def warm_up(state: TrainState) -> TrainState:
            return state._replace(normalizer=refit_normalizer(state, rollout, bounded))

        state = update(state) if bounded.all() else jax.lax.cond(state.iteration == 0, warm_up, update, state)
        state = state._replace(
            key=key, timestep=state.timestep + (config.chunk_size << k), iteration=state.iteration + 1
        )
        return state, rollout

    def segment(
        hyper: Hyperparameters,
        seed: Int[Array, ""],
        state: TrainState,
        first: Array,
        stop: Int[Array, ""],
    ) -> TrainState:
        state = jax.lax.cond(first, lambda: begin(hyper, seed), lambda: state)
        state = state._replace(episodes=state.episodes.reported())
        rollout = empty_rollout(
            env,
            distribution,
            max_chunks=max_chunks,
            chunk_steps=config.chunk_steps,
            num_envs=config.num_envs,
        )
        state, _ = jax.lax.while_loop(
            lambda carry: carry[0].timestep < stop, lambda carry: iteration(hyper, carry), (state, rollout)
        )
        score = validate(
            env,
            distribution,
            state.networks.actor.rollout(),
            state.normalizer,
            jax.random.split(purpose_key(seed, VALIDATE), config.num_eval_episodes),
        )
        validation = state.validation.update(score, state.timestep, state.networks.actor)
        if not config.reduce_lr:
            validation = validation._replace(lr_factor=jnp.float32(1))
        return state._replace(validation=validation)

    return segment


def empty_state(env: Env, config: PPOConfig, segment: Callable[..., TrainState]) -> TrainState:
    """A state of zeros of the right shapes, for the first call of ``segment``."""
    raise NotImplementedError


def stops(config: PPOConfig) -> list[int]:
    """The timesteps after which the training validates, reports and saves."""
    evenly = np.linspace(0, config.total_timesteps, config.num_evals + 1)[1:]
    return sorted({int(np.ceil(stop)) for stop in evenly})


def score_mean(total: Float[Array, ""], count: Int[Array, ""]) -> Float[Array, ""]:
    """A mean that is NaN where nothing was counted."""
    return total / count
