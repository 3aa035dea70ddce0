"""Training on any Gymnasium environment: the host steps it, the update is compiled."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import jax
import numpy as np
from jax import Array
from jaxtyping import Int

from ..envs.host import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..policies.distributions import distribution_of
from ..types import Transition
from .bounds_check import watch_bounds
from .collect import empty_rollout
from .collect_host import HostCollector
from .config import Config, Hyperparameters
from .growth import stage
from .init import init_state, normalizer_of
from .state import Episodes, TrainState
from .train_loop import improve, with_score
from .trainer import Compiled, Trainer
from .warm_start import Start, plant


class HostTrainer(Trainer):
    """Of any Gymnasium environment: the host steps it, the update is compiled.

    Every segment starts new episodes, seeded by the run's seed and the timestep: what happens after a segment
    depends on nothing that a checkpoint could not hold.
    """

    def __init__(self, spec: EnvSpec, config: Config, seed: int, start: Start | None = None) -> None:
        self._config, self._seed, self._hyper = config, seed, config.hyperparameters()
        distribution = self._distribution = distribution_of(spec.action_space)
        scaling = normalizer_of(spec.features, config)
        self._collector = HostCollector(spec, distribution, config)
        self.limit = self._collector.limit

        planted = None if start is None else start.parameters(config, seed)

        @jax.jit
        def begin(hyper: Hyperparameters, seed: Int[Array, ""]) -> TrainState:
            state = init_state(config, distribution, scaling[0], hyper, seed)
            return state if planted is None else plant(state, *planted)

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
            return improve(config, distribution, scaling, hyper, state, rollout, next_x, k, learn_key)

        @jax.jit
        def begin_segment(state: TrainState) -> TrainState:
            return state._replace(episodes=Episodes.zeros(config.num_envs))

        @jax.jit
        def judge(state: TrainState, score: Array) -> TrainState:
            return with_score(config, state, score)

        self._begin, self._begin_segment, self._judge = begin, begin_segment, judge
        self._template = jax.eval_shape(begin, self._hyper, np.uint32(seed))
        self._update = Compiled(update, self._template)

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
            score = self._collector.validate(now, self._seed)
        self.was_cut = self._collector.was_cut
        return self._judge(now, score)

    def close(self) -> None:
        """Close the environments."""
        self._collector.close()


@contextlib.contextmanager
def _named_step(state: TrainState, where: str) -> Iterator[None]:
    try:
        yield
    except EnvironmentFailure as failure:
        raise EnvironmentFailure(f"at training step {int(state.timestep):,}, {where}: {failure}") from failure
