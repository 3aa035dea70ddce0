"""The training loop: iterate until a timestep is reached, then validate.

The functions here are the same for every algorithm and for both sources of experience. With `JaxRollouts` a whole
*segment*, from one validation to the next, is one call of one compiled program; with `HostRollouts` the same lines run
in Python, and the functions that `Rollouts.compiled` returns are compiled. Where a training is cut into segments
changes nothing in what is learned from JAX environments. Whatever could change a shape is a trip count instead, so
nothing compiles twice.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int, PRNGKeyArray

from .algorithm import Algorithm, Experience, checked_metrics
from .config import Config, Hyperparameters
from .data_init import init_from_tree, init_thresholds
from .growth import stage
from .initialization import purpose_key
from .normalization import can_be_scaled, initial_normalizer, refit_normalizer, watch_bounds
from .optim import only_critic_learns, optimizer
from .rollouts import Rollouts, empty_rollout
from .state import Episodes, Guide, TrainState, Validation, WarmStartState, tree_where
from .warm_start import install_actor, install_teacher

Segment = Callable[[Hyperparameters, Any, TrainState, Any, Any], TrainState]


class Loop:
    """The training of one configuration as functions of its state.

    Args:
        config: The static part of the configuration; its traced numbers are not used.
        algorithm: The algorithm.
        rollouts: The source of experience.
        warm: Whether a new training starts from the actor of the state that it is given, and with
            ``config.method == "auto"`` from its critic, too.
    """

    def __init__(
        self, config: Config, algorithm: Algorithm, rollouts: Rollouts, *, warm: bool = False
    ) -> None:
        self.config = config
        self.algorithm = algorithm
        self.rollouts = rollouts
        self.warm = warm
        self._scaling = initial_normalizer(rollouts.bounds, config)
        self._update = jax.jit(
            algorithm.update, inline=True
        )  # traced once, also where only its shapes matter
        self._begin = rollouts.compiled(self.begin)
        self._is_unfinished = rollouts.compiled(self.is_unfinished)
        self._plan = rollouts.compiled(self.plan)
        self._learn = rollouts.compiled(self.learn, ahead=True)
        self._record = rollouts.compiled(self.record)

    def segment(
        self,
        hyper: Hyperparameters,
        seed: Int[Array, ""],
        state: TrainState,
        first: Any,
        stop: Int[Array, ""],
    ) -> TrainState:
        """Train until a timestep is reached, and validate.

        With `JaxRollouts` this is a pure function: jit it, or vmap it over ``hyper`` and ``seed``.

        Args:
            hyper: The traced hyperparameters.
            seed: The seed of the training.
            state: The state to continue from.
            first: Whether to begin a new training instead. Of ``state`` only the actor is used then, and that only for
                a warm start.
            stop: The timestep to reach.

        Returns:
            The state after the validation.
        """
        rollouts = self.rollouts
        state = rollouts.cond(first, lambda: self._begin(hyper, seed, state), lambda: state)
        state = rollouts.begin_segment(state, seed)
        state, _ = rollouts.while_loop(
            lambda carry: self._is_unfinished(carry[0], stop),
            lambda carry: self.iterate(hyper, *carry),
            (state, rollouts.buffer()),
        )
        returns, was_cut = rollouts.evaluate(state, seed)
        return rollouts.end_segment(self._record(state, returns)._replace(was_cut=was_cut))

    def iterate(self, hyper: Hyperparameters, state: TrainState, buffer: Any) -> tuple[TrainState, Any]:
        """Collect a rollout and learn from it.

        Args:
            hyper: The traced hyperparameters.
            state: The state before the rollout.
            buffer: The buffer that `Rollouts.buffer` returned, or the last rollout in it.

        Returns:
            The state after the update, and the buffer for the next rollout.
        """
        state, stage, collect_key, learn_key = self._plan(state)
        state, experience = self.rollouts.collect(state, buffer, stage, collect_key)
        state = self._learn(hyper, state, experience, learn_key)
        return state, None if buffer is None else experience.rollout

    def begin(self, hyper: Hyperparameters, seed: Int[Array, ""], given: TrainState) -> TrainState:
        """Make the state before the first step.

        Args:
            hyper: The traced hyperparameters.
            seed: The seed of the training.
            given: The state whose actor, and critic, a warm start begins with; otherwise unused.

        Returns:
            The state, with its environments reset.
        """
        state = self._random(hyper, seed)._replace(metrics=self.zero_metrics, was_cut=jnp.bool_(False))
        if not self.warm:
            return state
        if given.guide is not None:
            return install_teacher(state, given)
        return install_actor(state, given.networks.actor, given.warm)

    def _random(self, hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
        config, algorithm = self.config, self.algorithm
        networks: Any = algorithm.init_networks(hyper, purpose_key(seed, "init"))
        state = TrainState(
            networks=networks,
            opt_state=optimizer(hyper, jnp.float32(1), networks).init(networks),
            normalizer=self._scaling[0],
            outside=jnp.zeros((2, algorithm.num_features), bool),
            env_state=None,
            observation=None,
            key=jax.random.key_data(purpose_key(seed, "train")),
            timestep=jnp.int32(0),
            iteration=jnp.int32(0),
            episodes=Episodes.zeros(config.num_envs),
            metrics={},
            validation=Validation.create(networks.actor),
            memory=algorithm.init_memory(networks),
        )
        if self.warm:
            state = state._replace(warm=WarmStartState.zeros(config.depth))
            if config.method == "auto":
                state = state._replace(guide=Guide.zeros(algorithm.num_features))
        return self.rollouts.reset(state)

    def experience_shape(self) -> Experience:
        """Compute the shapes of the longest rollout.

        Returns:
            The experience, with `jax.ShapeDtypeStruct` in place of arrays.
        """
        algorithm, config = self.algorithm, self.config

        def largest() -> Experience:
            rollout = empty_rollout(algorithm.num_features, algorithm.distribution, config)
            return Experience(rollout, jnp.zeros((config.num_envs, algorithm.num_features)), jnp.int32(0))

        return jax.eval_shape(largest)

    def compile_learn(
        self, hyper: Hyperparameters, seed: Int[Array, ""], state: TrainState, *_: Any
    ) -> float:
        """Compile the update, unless that is done; for `HostRollouts`, where little else is compiled.

        Args:
            hyper: The traced hyperparameters.
            seed: The seed of the training.
            state: A state with the shapes of the training.
            _: The other arguments of `segment`, which are ignored.

        Returns:
            The seconds it took.
        """
        compiled: Any = self._learn
        return compiled.compile(hyper, state, self.experience_shape(), purpose_key(seed, "train"))

    def saved_template(self) -> TrainState:
        """Make a state of zeros to load a checkpoint into; no environment is opened and no update traced for it.

        Returns:
            A state with the shapes and types of every state of this training that is saved, without metrics.
        """
        shapes = jax.eval_shape(self._random, self.config.hyperparameters(), np.uint32(0))
        return jax.tree.map(lambda s: np.zeros(s.shape, s.dtype), shapes)

    def template(self) -> TrainState:
        """Make a state of zeros for `segment`; no environment is opened for it.

        Returns:
            A state with the shapes and types of every state of this training.
        """
        return self.saved_template()._replace(metrics=self.zero_metrics, was_cut=np.bool_(False))

    @functools.cached_property
    def zero_metrics(self) -> dict[str, Any]:
        """The metrics before the first update: zeros, under the names that the algorithm returns.

        Raises:
            TypeError: The algorithm's `update` returns something else than a state of the same form and scalar metrics.
        """
        key = jax.eval_shape(lambda: purpose_key(jnp.uint32(0), "train"))
        state = self.saved_template()._replace(was_cut=np.bool_(False))
        shapes = self.config.hyperparameters(), state, self.experience_shape(), key
        metrics = checked_metrics(self.algorithm, state, jax.eval_shape(self._update, *shapes))
        return jax.tree.map(lambda s: np.zeros(s.shape, s.dtype), metrics)

    def is_unfinished(self, state: TrainState, stop: Int[Array, ""]) -> Any:
        """Return whether another rollout follows.

        Args:
            state: The state of the training.
            stop: The timestep to reach.

        Returns:
            True before that timestep, unless the features cannot be scaled, which ends the training.
        """
        return (state.timestep < stop) & state.normalizer.is_valid()

    def plan(self, state: TrainState) -> tuple[TrainState, Int[Array, ""], PRNGKeyArray, PRNGKeyArray]:
        """Determine the size and the keys of the next rollout.

        Args:
            state: The state of the training.

        Returns:
            The state with its next key, the stage, the key of the rollout, and the key of its update.
        """
        key, collect_key, learn_key = jax.random.split(jax.random.wrap_key_data(state.key), 3)
        k = stage(state.timestep, self.config.total_timesteps, self.config.max_stage)
        return state._replace(key=jax.random.key_data(key)), k, collect_key, learn_key

    def learn(
        self, hyper: Hyperparameters, state: TrainState, experience: Experience, key: PRNGKeyArray
    ) -> TrainState:
        """Update the networks, or fit scales and thresholds to the first rollout.

        Args:
            hyper: The traced hyperparameters.
            state: The state after the rollout.
            experience: The rollout.
            key: The key of everything random in the update.

        Returns:
            The state after the update, its counters advanced.
        """
        config, scaling, rollout = self.config, self._scaling, experience.rollout
        state = watch_bounds(self.rollouts.bounds, state, rollout, experience.num_chunks)

        def update(state: TrainState) -> TrainState:
            updated, metrics = self._update(hyper, state._replace(metrics={}), experience, key)
            return updated._replace(metrics=metrics)

        def fit(state: TrainState) -> TrainState:
            valid = can_be_scaled(rollout)
            if state.warm is not None:
                state = init_from_tree(scaling, state, rollout, key)
            elif places_thresholds:
                state = init_thresholds(scaling, state, rollout, key)
            else:
                state = state._replace(normalizer=refit_normalizer(state.normalizer, rollout, scaling[1]))
            return state._replace(normalizer=state.normalizer.where_valid(valid))

        places_thresholds = config.threshold_init == "visited"
        nothing_to_fit = scaling[1].all() and state.warm is None and not places_thresholds
        state = update(state) if nothing_to_fit else jax.lax.cond(state.iteration == 0, fit, update, state)
        timestep = state.timestep + (config.chunk_size << experience.stage)
        return state._replace(timestep=timestep, iteration=state.iteration + 1)

    def record(self, state: TrainState, returns: Array) -> TrainState:
        """Record a validation: the best actor, the learning rates, and with ``rollback`` the actor to continue from.

        Args:
            state: The state that was validated.
            returns: The return of each validation episode.

        Returns:
            The state to continue from.
        """
        config, networks = self.config, state.networks
        validation = state.validation.update(
            jnp.mean(returns), state.timestep, networks.actor, reduce_lr=config.reduce_lr
        )
        if state.warm is not None:  # the actor cannot improve while only the critic learns
            num_bad = jnp.where(only_critic_learns(config, state), 0, validation.num_bad)
            validation = validation._replace(num_bad=num_bad)
        if config.rollback:
            halved = validation.lr_factor < state.validation.lr_factor
            networks = networks._replace(actor=tree_where(halved, validation.best_actor, networks.actor))
        return state._replace(validation=validation, networks=networks)
