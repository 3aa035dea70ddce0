"""Experience from environments that the host steps; the policy samples in one compiled call a step."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np
from jax import Array
from jaxtyping import Float32, Int, PRNGKeyArray

from ..envs.errors import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..policies.actor import Actor
from ..types import Transition
from .algorithm import Algorithm, Experience
from .compiled import Compiled
from .config import Config
from .initialization import host_seed
from .rollouts import Rollouts, validation_limit
from .state import Episodes, Normalizer, TrainState


class HostRollouts(Rollouts):
    """Copies of an environment that are stepped through Gymnasium's API or in native code.

    Every segment starts new episodes, seeded by the training's seed and the timestep: what happens after a validation
    depends on nothing that a checkpoint could not hold. The environments are opened when they are first needed.

    Args:
        spec: The environment.
        config: The static part of the configuration.
        algorithm: The algorithm.
    """

    def __init__(self, spec: EnvSpec, config: Config, algorithm: Algorithm) -> None:
        limit = validation_limit(spec.max_episode_steps, config, config.num_eval_episodes)
        super().__init__(config, algorithm, spec.features, limit)
        self._spec = spec
        self._envs: Any = None
        self._observation = np.zeros((config.num_envs, algorithm.num_features), np.float32)
        distribution = algorithm.distribution

        # what a step needs of the policy, and a chunk of its noise, is computed before: a step is all dispatch
        @jax.jit
        def for_acting(actor: Actor) -> Any:
            return actor.rollout()

        @jax.jit
        def draw(key: PRNGKeyArray, chunk: Int[Array, ""]) -> Array:
            act, _ = jax.random.split(jax.random.fold_in(key, chunk))
            return distribution.noise(act, (config.chunk_steps, config.num_envs))

        @jax.jit
        def act(
            policy: Any, log_std: Array, normalizer: Normalizer, noise: Array, observation: Array
        ) -> tuple[Array, Array]:
            action = algorithm.sample(policy(normalizer(observation)), log_std, noise)
            return action, distribution.to_env(action)

        @jax.jit
        def decide(policy: Any, normalizer: Normalizer, observation: Array) -> Array:
            return distribution.to_env(distribution.mode(policy(normalizer(observation))))

        @jax.jit
        def scaled(
            state: TrainState, rollout: Transition, observation: Array, stage: Int[Array, ""]
        ) -> tuple[TrainState, Experience]:
            done = rollout.terminated | rollout.truncated
            episodes = jax.lax.fori_loop(
                0, 1 << stage, lambda i, episodes: episodes.steps(rollout.reward[i], done[i]), state.episodes
            )
            normalize = state.normalizer
            rollout = rollout._replace(
                observation=normalize(rollout.observation),
                last_observation=normalize(rollout.last_observation),
            )
            return state._replace(episodes=episodes), Experience(rollout, normalize(observation), stage)

        @jax.jit
        def without_episodes(state: TrainState) -> TrainState:
            return state._replace(episodes=Episodes.zeros(config.num_envs))

        self._for_acting, self._draw, self._act, self._decide = for_acting, draw, act, decide
        self._scaled, self._without_episodes = scaled, without_episodes

    def compiled(self, function: Callable[..., Any], *, ahead: bool = False) -> Callable[..., Any]:
        """See `Rollouts.compiled`."""
        return Compiled(function) if ahead else jax.jit(function)

    def cond(self, condition: Any, on_true: Callable[[], Any], on_false: Callable[[], Any]) -> Any:
        """See `Rollouts.cond`."""
        return on_true() if condition else on_false()

    def while_loop(self, condition: Callable[[Any], Any], body: Callable[[Any], Any], carry: Any) -> Any:
        """See `Rollouts.while_loop`. What the last rollout before a validation brought counts once it is validated."""
        goes_on = bool(condition(carry))
        while goes_on:
            carry = body(carry)
            goes_on = bool(condition(carry))
            if goes_on:
                self.latest = carry[0]
        return carry

    def reset(self, state: TrainState) -> TrainState:
        """Do nothing: `begin_segment` begins all episodes."""
        return state

    def begin_segment(self, state: TrainState, seed: Any) -> TrainState:
        """Begin new episodes everywhere; see `Rollouts.begin_segment`."""
        self.latest, timestep = None, int(state.timestep)
        with _with_step(timestep, "on a new start"):
            self._observation = self._open().reset(host_seed(int(seed), "train", timestep))
        return self._without_episodes(state)

    def buffer(self) -> None:
        """Return None: `collect` writes into NumPy arrays of its own."""

    def collect(
        self, state: TrainState, buffer: Transition | None, stage: Any, key: PRNGKeyArray
    ) -> tuple[TrainState, Experience]:
        """See `Rollouts.collect`.

        Raises:
            EnvironmentFailure: An environment failed; the message names the training step.
        """
        config, rollout, noise = self.config, None, np.zeros(0)
        envs, timestep = self._open(), int(state.timestep)
        policy, log_std = self._for_acting(state.networks.actor), state.networks.actor.log_std
        for i in range(config.chunk_steps << int(stage)):
            chunk, step_of_chunk = divmod(i, config.chunk_steps)
            if step_of_chunk == 0:
                noise = np.asarray(self._draw(key, np.int32(chunk)))
            observation = self._observation
            action, env_action = self._act(
                policy, log_std, state.normalizer, noise[step_of_chunk], observation
            )
            with _with_step(timestep + i * config.num_envs):
                step, self._observation = envs.step(np.asarray(env_action))
            arrays: Any = (observation, np.asarray(action), *step[1:], step.observation)
            transition = Transition(*arrays)
            if rollout is None:
                rollout = self._rollout_like(transition)
            for array, row in zip(rollout, transition, strict=True):
                array[chunk, step_of_chunk] = row  # pyright: ignore[reportIndexIssue]
        return self._scaled(state, rollout, self._observation, stage)

    def evaluate(
        self, state: TrainState, seed: Any, num_episodes: int | None = None
    ) -> tuple[Float32[np.ndarray, " episodes"], bool]:
        """See `Rollouts.evaluate`. An episode that reaches `limit` is cut there, and its copy begins the next one."""
        with _with_step(int(state.timestep), "in validation"):
            return self._play(state, int(seed), num_episodes or self.config.num_eval_episodes)

    def _play(
        self, state: TrainState, seed: int, num_episodes: int
    ) -> tuple[Float32[np.ndarray, " episodes"], bool]:
        envs, returns = self._open(), np.zeros(num_episodes)
        policy = self._for_acting(state.networks.actor)
        observation = envs.reset(host_seed(seed, "validation"), num_episodes)
        while np.any(playing := envs.episode < num_episodes):
            episode = envs.episode[playing]
            action = self._decide(policy, state.normalizer, observation)
            step, observation = envs.step(np.asarray(action), playing, self.limit)
            returns[episode] += step.reward[playing]
        return returns.astype(np.float32), bool(envs.was_cut)

    def close(self) -> None:
        """See `Rollouts.close`."""
        if self._envs is not None:
            self._envs.close()
            self._envs = None

    def _open(self) -> Any:
        if self._envs is None:
            self._envs = self._spec.host_envs(self.config.num_envs)
        return self._envs

    def _rollout_like(self, transition: Transition) -> Transition:
        """Return zeros for the longest rollout; pages that are never written take no memory."""
        axes = (1 << self.config.max_stage, self.config.chunk_steps)
        return jax.tree.map(lambda a: np.zeros((*axes, *np.shape(a)), np.asarray(a).dtype), transition)


@contextlib.contextmanager
def _with_step(timestep: int, where: str = "") -> Iterator[None]:
    """Name the training step in the message of an EnvironmentFailure."""
    try:
        yield
    except EnvironmentFailure as failure:
        place = f"{timestep:,}, {where}" if where else f"{timestep:,}"
        raise EnvironmentFailure(f"at training step {place}: {failure}") from failure
