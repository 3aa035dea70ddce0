"""Experience from Gymnasium environments: the host steps them, the policy samples in one compiled call."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from ..envs.adapters.gymnasium import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..policies.actor import Actor
from ..policies.distributions import Distribution
from ..types import Transition
from .config import Config
from .init import PURPOSES
from .state import Normalizer, TrainState
from .validate import validation_limit


def host_seed(seed: int, purpose: str, timestep: int = 0) -> int:
    """A seed for the host's environments; no two purposes, seeds or timesteps share one (up to chance, 2⁻⁶³)."""
    words = np.random.SeedSequence([seed, PURPOSES.index(purpose), timestep]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


class HostCollector:
    """The environments of one training, and the buffer that its rollouts are written to."""

    def __init__(self, spec: EnvSpec, distribution: Distribution, config: Config) -> None:
        self._config = config
        self._open = partial(spec.host_envs, config.num_envs)
        self._envs = self._open()
        self._is_closed = False
        self._observation = np.zeros((config.num_envs, len(spec.features.names)), np.float32)
        self._quota = -(-config.num_eval_episodes // config.num_envs)
        self.limit = validation_limit(spec.max_episode_steps, config, self._quota * config.num_envs)
        """Steps after which validation cuts an episode."""
        self.was_cut = False
        """Whether the last validation cut one."""

        # what a step needs of the policy, and a chunk of its noise, is worked out before: a step is all dispatch
        @jax.jit
        def choose(actor: Actor) -> Any:
            return actor.rollout()

        @jax.jit
        def draw(key: Array, chunk: Int[Array, ""]) -> Array:
            # the update splits the same key in two, and JAX's split(key)[i] is fold_in(key, i): so not 0, not 1
            noise_key = jax.random.fold_in(jax.random.wrap_key_data(key), 2)
            steps = chunk * config.chunk_steps + jnp.arange(config.chunk_steps)
            keys = jax.vmap(lambda step: jax.random.fold_in(noise_key, step))(steps)
            return jax.vmap(lambda key: distribution.noise(key, (config.num_envs,)))(keys)

        @jax.jit
        def act(
            policy: Any, log_std: Array, normalizer: Normalizer, noise: Array, observation: Array
        ) -> tuple[Array, Array]:
            action = distribution.sample(policy(normalizer(observation)), log_std, noise)
            return action, distribution.to_env(action)

        @jax.jit
        def decide(policy: Any, normalizer: Normalizer, observation: Array) -> Array:
            return distribution.to_env(distribution.mode(policy(normalizer(observation))))

        self._choose, self._draw, self._act, self._decide = choose, draw, act, decide

    def begin(self, seed: int, timestep: int) -> None:
        """Start new episodes everywhere; after `close`, in new environments."""
        if self._is_closed:
            self._envs, self._is_closed = self._open(), False
        self._observation = self._envs.reset(host_seed(seed, "train", timestep))

    def collect(
        self, state: TrainState, num_chunks: int
    ) -> tuple[Transition, Float[np.ndarray, "envs features"]]:
        """Steps for ``num_chunks`` chunks, unscaled, and the observation after the last.

        Raises EnvironmentFailure, naming the step, when an environment does.
        """
        config, rollout, noise = self._config, None, np.zeros(0)
        policy, log_std = self._choose(state.networks.actor), state.networks.actor.log_std
        for i in range(num_chunks * config.chunk_steps):
            chunk, step_of_chunk = divmod(i, config.chunk_steps)
            if step_of_chunk == 0:
                noise = np.asarray(self._draw(state.key, np.int32(chunk)))
            observation = self._observation
            action, env_action = self._act(
                policy, log_std, state.normalizer, noise[step_of_chunk], observation
            )
            try:
                step, self._observation = self._envs.step(np.asarray(env_action))
            except EnvironmentFailure as failure:
                at = int(state.timestep) + i * config.num_envs
                raise EnvironmentFailure(f"at training step {at:,}: {failure}") from failure
            row: Any = (
                observation,
                np.asarray(action),
                *step[1:],
                step.observation,
            )  # NumPy's arrays, not JAX's
            transition = Transition(*row)
            rollout = rollout if rollout is not None else self._buffer(transition)
            jax.tree.map(_writer(chunk, step_of_chunk), rollout, transition)
        assert rollout is not None
        return rollout, self._observation

    def validate(self, state: TrainState, seed: int) -> np.float32:
        """Mean return of the deterministic tree; every copy plays the same number of episodes.

        An episode that reaches `limit` is cut there: its copy is reset, and the next one is an episode of its own.
        """
        num_envs, quota = self._config.num_envs, self._quota
        running, played, total = np.zeros(num_envs), np.zeros(num_envs, int), 0.0
        policy = self._choose(state.networks.actor)
        observation = self._envs.reset(host_seed(seed, "validation"))
        while np.any(playing := played < quota):
            action = self._decide(policy, state.normalizer, observation)
            step, observation = self._envs.step(np.asarray(action), playing, self.limit)
            running = running + step.reward
            done = step.terminated | step.truncated
            total += float(running[done & playing].sum())
            played, running = played + done, np.where(done, 0, running)
        self.was_cut = self._envs.was_cut
        return np.float32(total / (quota * num_envs))

    def close(self) -> None:
        """Close the environments."""
        self._envs.close()
        self._is_closed = True

    def _buffer(self, transition: Transition) -> Transition:
        axes = (1 << self._config.max_stage, self._config.chunk_steps)
        return jax.tree.map(lambda a: np.zeros((*axes, *np.shape(a)), np.asarray(a).dtype), transition)


def _writer(chunk: int, step: int) -> Any:
    def write(buffer: np.ndarray, value: np.ndarray) -> None:
        buffer[chunk, step] = value

    return write
