"""The training loop, compiled once.

A *segment* is: iterate until a timestep is reached, then validate. The host runs segment after segment, and
between two of them it saves, reports and may stop. For a pure-JAX environment a segment is one call of one
compiled program; where the calls are cut changes nothing in what is computed. For a Gymnasium environment the
host collects, and only the update is compiled. Whatever could change a shape is a trip count instead, so
nothing compiles twice.
"""

from __future__ import annotations

import abc
import contextlib
import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np
from jax import Array
from jaxtyping import Int

from ..envs.env import Env
from ..envs.host import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..functional.schedules import stage
from ..policies.distributions import Distribution, distribution_of
from ..types import Transition
from . import a2c, ppo
from .bounds import watch_bounds
from .collect import collect, empty_rollout, reset_envs
from .collect_host import HostCollector
from .config import Config, Hyperparameters
from .init import init_state, normalizer_of, purpose_key, refit_normalizer
from .state import Episodes, TrainState, tree_where
from .validate import validate

COMPILER_OPTIONS: dict[str, bool | str] = {
    "xla_backend_optimization_level": "1",
    "xla_llvm_disable_expensive_passes": "True",
}
"""Of LLVM: it compiles in three fifths of the time and, these loops being what they are, runs no slower."""

LEARN = {"ppo": ppo.learn, "a2c": a2c.learn}

Segment = Callable[[Hyperparameters, Any, TrainState, Any, Any], TrainState]


def stops(config: Config) -> list[int]:
    """The timesteps after which the training validates, reports and saves."""
    evenly = np.linspace(0, config.total_timesteps, config.num_evals + 1)[1:]
    return sorted({int(np.ceil(stop)) for stop in evenly})


def make_segment(env: Env, config: Config) -> tuple[Segment, TrainState]:
    """The function ``segment(hyper, seed, state, first, stop)`` and a state of zeros to start it with.

    With ``first`` the state's values are ignored and a new training begins. A pure function: jit it, vmap it
    over ``hyper`` and ``seed``. ``config`` gives what is static; its traced numbers are not looked at.
    """
    distribution = distribution_of(env.action_space)
    normalizer, bounded = normalizer_of(env.observation_space, config)
    bounds = env.observation_space

    def begin(hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
        state = init_state(config, distribution, normalizer, hyper, seed)
        key, reset_key = jax.random.split(jax.random.wrap_key_data(state.key))
        env_state, observation = reset_envs(env, reset_key, config.num_envs)
        return state._replace(key=jax.random.key_data(key), env_state=env_state, observation=observation)

    def iteration(
        hyper: Hyperparameters, state: TrainState, rollout: Transition
    ) -> tuple[TrainState, Transition]:
        key, collect_key, learn_key = jax.random.split(jax.random.wrap_key_data(state.key), 3)
        state = state._replace(key=jax.random.key_data(key))
        k = stage(state.timestep, config.total_timesteps, config.max_stage)
        state, rollout = collect(env, distribution, state, rollout, 1 << k, collect_key)
        next_x = state.normalizer(state.observation)
        state = watch_bounds(bounds, state, rollout, 1 << k)
        return improve(config, distribution, bounded, hyper, state, rollout, next_x, k, learn_key), rollout

    def segment(
        hyper: Hyperparameters, seed: Int[Array, ""], state: TrainState, first: Array, stop: Int[Array, ""]
    ) -> TrainState:
        state = jax.lax.cond(first, lambda: begin(hyper, seed), lambda: state)
        state = state._replace(episodes=state.episodes.reported())
        rollout = empty_rollout(env.observation_space.shape[0], distribution, config)
        state, _ = jax.lax.while_loop(
            lambda carry: carry[0].timestep < stop, lambda carry: iteration(hyper, *carry), (state, rollout)
        )
        actor = state.networks.actor
        key, policy = purpose_key(seed, "validation"), actor.rollout()
        score = validate(env, distribution, policy, state.normalizer, key, config.num_eval_episodes)
        return with_score(config, state, score)

    shapes = jax.eval_shape(begin, config.hyperparameters(), np.uint32(0))
    return segment, jax.tree.map(lambda s: np.zeros(s.shape, s.dtype), shapes)


def improve(
    config: Config,
    distribution: Distribution,
    bounded: np.ndarray,
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
        return state._replace(normalizer=refit_normalizer(state.normalizer, rollout, bounded))

    state = update(state) if bounded.all() else jax.lax.cond(state.iteration == 0, warm_up, update, state)
    return state._replace(timestep=state.timestep + (config.chunk_size << k), iteration=state.iteration + 1)


def with_score(config: Config, state: TrainState, score: Array) -> TrainState:
    """The state after a validation."""
    validation = state.validation.update(
        score, state.timestep, state.networks.actor, reduce_lr=config.reduce_lr
    )
    networks = state.networks
    if config.rollback:
        halved = validation.lr_factor < state.validation.lr_factor
        networks = networks._replace(actor=tree_where(halved, validation.best_actor, networks.actor))
    return state._replace(validation=validation, networks=networks)


class Trainer(abc.ABC):
    """Trains one seed, a segment at a time."""

    latest: TrainState | None = None
    """What a segment that failed had come to by its last update, where the host has seen one."""

    @abc.abstractmethod
    def compile(self) -> float:
        """Compile, unless this process has done so before; the seconds it took."""

    @abc.abstractmethod
    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """Train until ``stop`` timesteps and validate; None begins a new training."""

    @abc.abstractmethod
    def template(self) -> TrainState:
        """A state of the right shapes, its values of no meaning."""

    def close(self) -> None:  # noqa: B027  (nothing to close inside a compiled program)
        """Let go of what the host holds."""


class CompiledTrainer(Trainer):
    """Of a pure-JAX environment: a segment is one call."""

    def __init__(self, env: Env, config: Config, seed: int) -> None:
        self._program = _program(env, config.static())
        self._hyper, self._seed = config.hyperparameters(), np.uint32(seed)

    def compile(self) -> float:
        """See `Trainer`."""
        return self._program.compile(*self._arguments(None, 0))

    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """See `Trainer`."""
        return self._program(*self._arguments(state, stop))

    def template(self) -> TrainState:
        """See `Trainer`."""
        return self._program.template

    def _arguments(self, state: TrainState | None, stop: int) -> tuple[Any, ...]:
        state, first = (self._program.template, True) if state is None else (state, False)
        return self._hyper, self._seed, state, np.bool_(first), np.int32(stop)


class _Compiled:
    """A function compiled once, ahead of its first call, for the shapes of one set of arguments."""

    def __init__(self, function: Callable[..., TrainState], template: TrainState) -> None:
        self._function, self._executable = jax.jit(function), None
        self.template = template

    def compile(self, *arguments: Any) -> float:
        if self._executable is not None:
            return 0.0
        began = time.perf_counter()
        self._executable = self._function.lower(*arguments).compile(COMPILER_OPTIONS)
        return time.perf_counter() - began

    def __call__(self, *arguments: Any) -> TrainState:
        self.compile(*arguments)
        return self._executable(*arguments)  # pyright: ignore[reportOptionalCall]


def _program(env: Env, config: Config) -> _Compiled:
    try:
        hash(env)
    except TypeError:  # nothing to know it by: compiled anew for each training
        return _Compiled(*make_segment(env, config))
    return _known_program(env, config)


@functools.lru_cache(maxsize=8)
def _known_program(env: Env, config: Config) -> _Compiled:
    return _Compiled(*make_segment(env, config))


class HostTrainer(Trainer):
    """Of any Gymnasium environment: the host steps it, the update is compiled.

    Every segment starts new episodes, seeded by the run's seed and the timestep: what happens after a segment
    depends on nothing that a checkpoint could not hold.
    """

    def __init__(self, spec: EnvSpec, config: Config, seed: int) -> None:
        self._config, self._seed, self._hyper = config, seed, config.hyperparameters()
        distribution = self._distribution = distribution_of(spec.action_space)
        normalizer, bounded = normalizer_of(spec.features, config)
        self._collector = HostCollector(spec, distribution, config)

        @jax.jit
        def begin(hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
            return init_state(config, distribution, normalizer, hyper, seed)

        def update(
            hyper: Hyperparameters, state: TrainState, rollout: Transition, observation: Array
        ) -> TrainState:
            key, learn_key = jax.random.split(jax.random.wrap_key_data(state.key))
            k = stage(state.timestep, config.total_timesteps, config.max_stage)
            done = rollout.terminated | rollout.truncated
            episodes = jax.lax.fori_loop(
                0, 1 << k, lambda i, episodes: episodes.steps(rollout.reward[i], done[i]), state.episodes
            )
            state = state._replace(key=jax.random.key_data(key), episodes=episodes)
            rollout = rollout._replace(
                observation=state.normalizer(rollout.observation),
                last_observation=state.normalizer(rollout.last_observation),
            )
            next_x = state.normalizer(observation)
            state = watch_bounds(spec.features, state, rollout, 1 << k)
            return improve(config, distribution, bounded, hyper, state, rollout, next_x, k, learn_key)

        @jax.jit
        def begin_segment(state: TrainState) -> TrainState:
            return state._replace(episodes=Episodes.zeros(config.num_envs))

        @jax.jit
        def judge(state: TrainState, score: Array) -> TrainState:
            return with_score(config, state, score)

        self._begin, self._begin_segment, self._judge = begin, begin_segment, judge
        self._template = jax.eval_shape(begin, self._hyper, np.uint32(seed))
        self._update = _Compiled(update, self._template)

    def compile(self) -> float:
        """See `Trainer`: of the update, which is nearly all there is to compile."""
        features = self._template.normalizer.shift.shape[0]
        rollout = jax.eval_shape(lambda: empty_rollout(features, self._distribution, self._config))
        observation = jax.ShapeDtypeStruct((self._config.num_envs, features), np.float32)
        return self._update.compile(self._hyper, self._template, rollout, observation)

    def template(self) -> TrainState:
        """See `Trainer`."""
        return self._template

    def advance(self, state: TrainState | None, stop: int) -> TrainState:
        """See `Trainer`."""
        config = self._config
        self.latest = state
        now: TrainState = self._begin_segment(state or self._begin(self._hyper, np.uint32(self._seed)))
        with _named_step(now, "on a new start"):
            self._collector.begin(self._seed, int(now.timestep))
        while (timestep := int(now.timestep)) < stop:
            num_chunks = 1 << stage(timestep, config.total_timesteps, config.max_stage)
            rollout, observation = self._collector.collect(now, num_chunks)
            now = self._update(self._hyper, now, rollout, observation)
            if int(now.timestep) < stop:  # the last one counts once it is validated
                self.latest = now
        with _named_step(now, "in validation"):
            return self._judge(now, self._collector.validate(now, self._seed))

    def close(self) -> None:
        """Close the environments."""
        self._collector.close()


@contextlib.contextmanager
def _named_step(state: TrainState, where: str) -> Iterator[None]:
    try:
        yield
    except EnvironmentFailure as failure:
        raise EnvironmentFailure(f"at training step {int(state.timestep):,}, {where}: {failure}") from failure


def make_trainer(spec: EnvSpec, config: Config, seed: int) -> Trainer:
    """Compiled where the environment is written in JAX, through the host otherwise."""
    if spec.env is not None:
        return CompiledTrainer(spec.env, config, seed)
    return HostTrainer(spec, config, seed)
