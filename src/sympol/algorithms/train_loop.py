"""What is compiled: a segment of the training, and what a rollout and a validation do to its state.

A *segment* is: iterate until a timestep is reached, then validate. Where the calls are cut changes nothing in what is
computed. Whatever could change a shape is a trip count instead, so nothing compiles twice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.sharding import Mesh
from jaxtyping import Int

from ..envs.env import Env
from ..policies.distributions import Distribution, distribution_of
from ..types import Transition
from . import a2c, ppo
from .bounds_check import watch_bounds
from .collect import collect, empty_rollout, reset_envs
from .config import Config, Hyperparameters
from .freezing import warming_up
from .growth import stage
from .init import are_held, init_state, normalizer_of, purpose_key, refit_normalizer
from .normalize_start import settle, spread
from .sharding import divide_envs
from .state import Normalizer, TrainState, Warm, tree_where
from .validate import limit_in, validate
from .warm_start import plant

LEARN = {"ppo": ppo.learn, "a2c": a2c.learn}

Segment = Callable[[Hyperparameters, Any, TrainState, Any, Any], TrainState]


def make_segment(
    env: Env, config: Config, mesh: Mesh | None = None, *, warm: bool = False
) -> tuple[Segment, TrainState]:
    """The function ``segment(hyper, seed, state, first, stop)`` and a state of zeros to start it with.

    With ``first`` the state's values are ignored and a new training begins. A pure function: jit it, vmap it
    over ``hyper`` and ``seed``. ``config`` gives what is static; its traced numbers are not looked at.
    With a ``mesh`` the environments are divided among its devices. With ``warm`` the new training begins with the
    actor of ``state`` (`sympol.algorithms.warm_start`).
    """
    distribution = distribution_of(env.action_space)
    scaling = normalizer_of(env.observation_space, config)
    bounds, num_episodes = env.observation_space, config.num_eval_episodes
    limit = limit_in(env, config)

    def begin(hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
        state = init_state(config, distribution, scaling[0], hyper, seed)
        if warm:
            state = state._replace(warm=Warm.create(config.depth))
        key, reset_key = jax.random.split(jax.random.wrap_key_data(state.key))
        env_state, observation = reset_envs(env, reset_key, config.num_envs)
        state = state._replace(env_state=env_state, observation=observation, cut=jnp.bool_(False))
        return state._replace(key=jax.random.key_data(key))

    def iteration(
        hyper: Hyperparameters, state: TrainState, rollout: Transition
    ) -> tuple[TrainState, Transition]:
        key, collect_key, learn_key = jax.random.split(jax.random.wrap_key_data(state.key), 3)
        state = state._replace(key=jax.random.key_data(key))
        k = stage(state.timestep, config.total_timesteps, config.max_stage)
        state, rollout = collect(env, distribution, state, rollout, 1 << k, collect_key)
        next_x = state.normalizer(state.observation)
        state = watch_bounds(bounds, state, rollout, 1 << k)
        return improve(config, distribution, scaling, hyper, state, rollout, next_x, k, learn_key), rollout

    def segment(
        hyper: Hyperparameters, seed: Int[Array, ""], state: TrainState, first: Array, stop: Int[Array, ""]
    ) -> TrainState:
        given = state
        state = jax.lax.cond(first, lambda: begin(hyper, seed), lambda: given)
        if warm:
            state = jax.lax.cond(first, lambda: plant(state, given.networks.actor, given.warm), lambda: state)
        state = state._replace(episodes=state.episodes.reported())
        rollout = empty_rollout(env.observation_space.shape[0], distribution, config)
        rollout = jax.tree.map(lambda a: divide_envs(a, 2, mesh), rollout)
        state, _ = jax.lax.while_loop(
            lambda carry: (carry[0].timestep < stop) & carry[0].normalizer.is_there(),
            lambda carry: iteration(hyper, *carry),
            (state, rollout),
        )
        actor = state.networks.actor
        key, policy = purpose_key(seed, "validation"), actor.rollout()
        score, cut = validate(env, distribution, policy, state.normalizer, key, num_episodes, limit)
        return with_score(config, state, score)._replace(cut=cut)

    shapes = jax.eval_shape(begin, config.hyperparameters(), np.uint32(0))
    return segment, jax.tree.map(lambda s: np.zeros(s.shape, s.dtype), shapes)


def improve(
    config: Config,
    distribution: Distribution,
    scaling: tuple[Normalizer, np.ndarray],
    hyper: Hyperparameters,
    state: TrainState,
    rollout: Transition,
    next_x: Array,
    k: Int[Array, ""],
    key: Any,
) -> TrainState:
    """What a rollout is for: an update, or the scale of the features if it is the first and they have none."""

    def update(state: TrainState) -> TrainState:
        return LEARN[config.algorithm](config, distribution, hyper, state, rollout, next_x, k, key)

    def warm_up(state: TrainState) -> TrainState:
        held = are_held(rollout)
        if state.warm is not None:
            state = settle(scaling, state, rollout, key)
        elif spreads:
            state = spread(scaling, state, rollout, key)
        else:
            state = state._replace(normalizer=refit_normalizer(state.normalizer, rollout, scaling[1]))
        return state._replace(normalizer=state.normalizer.or_none(held))

    spreads = config.threshold_init == "visited"
    goes_without = scaling[1].all() and state.warm is None and not spreads
    state = update(state) if goes_without else jax.lax.cond(state.iteration == 0, warm_up, update, state)
    return state._replace(timestep=state.timestep + (config.chunk_size << k), iteration=state.iteration + 1)


def with_score(config: Config, state: TrainState, score: Array) -> TrainState:
    """The state after a validation."""
    validation = state.validation.update(
        score, state.timestep, state.networks.actor, reduce_lr=config.reduce_lr
    )
    networks = state.networks
    if state.warm is not None:  # it cannot get better while only the critic learns
        validation = validation._replace(num_bad=jnp.where(warming_up(config, state), 0, validation.num_bad))
    if config.rollback:
        halved = validation.lr_factor < state.validation.lr_factor
        networks = networks._replace(actor=tree_where(halved, validation.best_actor, networks.actor))
    return state._replace(validation=validation, networks=networks)
