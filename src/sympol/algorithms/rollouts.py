"""Sources of experience.

`Rollouts` is the interface; it has two implementations. `JaxRollouts` steps environments that are written in JAX inside
the compiled program; `sympol.algorithms.host_rollouts` steps Gymnasium environments on the host, and only what happens
between two rollouts is compiled. Control flow follows from that: ``cond`` and ``while_loop`` are those of `jax.lax` in
the first case and Python's own in the second, so that `sympol.algorithms.loop` is written once.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.sharding import Mesh
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from ..envs.env import MAX_EPISODE_STEPS, Env
from ..policies.distributions import Distribution
from ..types import Transition
from .algorithm import Algorithm, Experience
from .config import Config
from .initialization import purpose_key
from .normalization import Bounded
from .restart import block_size, restart
from .sharding import divide_envs
from .state import Episodes, TrainState, tree_where

SHORTEST_CUT = 1_000
"""No validation episode is cut before that many steps, however short the training."""


class Rollouts(abc.ABC):
    """A source of experience for one training.

    Args:
        config: The static part of the configuration.
        algorithm: The algorithm, which chooses the actions.
        bounds: The bounds of a flat observation.
        limit: The number of steps after which a validation episode is cut.
    """

    def __init__(self, config: Config, algorithm: Algorithm, bounds: Bounded, limit: int) -> None:
        self.config = config
        self.algorithm = algorithm
        self.bounds = bounds
        self.limit = limit

    @property
    def latest(self) -> TrainState | None:
        """The state after the last rollout, should the next one fail; None inside a compiled program."""
        return None

    @abc.abstractmethod
    def compiled(self, function: Callable[..., Any], *, ahead: bool = False) -> Callable[..., Any]:
        """Return a function ready to be called: compiled, or as it is where the caller is compiled already.

        Args:
            function: A pure function.
            ahead: Whether it is so large that it is to be compiled before its first call, by `Compiled.compile`.

        Returns:
            The function to call in its place.
        """

    @abc.abstractmethod
    def cond(self, condition: Any, on_true: Callable[[], Any], on_false: Callable[[], Any]) -> Any:
        """Call one of two functions, as `jax.lax.cond` does.

        Args:
            condition: A boolean scalar.
            on_true: The function to call if it is true.
            on_false: The function to call otherwise.

        Returns:
            The result of the function.
        """

    @abc.abstractmethod
    def while_loop(self, condition: Callable[[Any], Any], body: Callable[[Any], Any], carry: Any) -> Any:
        """Repeat a function while a condition holds, as `jax.lax.while_loop` does.

        Args:
            condition: A function of the carry.
            body: A function of the carry that returns the next one.
            carry: A tuple whose first part is the state of the training.

        Returns:
            The last carry.
        """

    @abc.abstractmethod
    def reset(self, state: TrainState) -> TrainState:
        """Begin the first episodes of a new training.

        Args:
            state: The state of the training, without environments.

        Returns:
            The state with environments that have been reset.
        """

    @abc.abstractmethod
    def begin_segment(self, state: TrainState, seed: Any) -> TrainState:
        """Prepare for the rollouts until the next validation; episode statistics start from zero.

        Args:
            state: The state of the training.
            seed: The seed of the training.

        Returns:
            The state to continue from.
        """

    @abc.abstractmethod
    def buffer(self) -> Transition | None:
        """Allocate the memory of rollouts.

        Returns:
            A buffer for the longest rollout, or None where `collect` makes its own.
        """

    @abc.abstractmethod
    def collect(
        self, state: TrainState, buffer: Transition | None, stage: Any, key: PRNGKeyArray
    ) -> tuple[TrainState, Experience]:
        """Step the environments for ``2**stage`` chunks.

        Args:
            state: The state of the training; its actor acts.
            buffer: Where to write the transitions.
            stage: How often the rollout has doubled.
            key: The key of everything random.

        Returns:
            The state, with its environments and episode statistics moved on, and the experience. Observations are
            scaled, as the networks see them; those at which an episode ended are its true last observations.
        """

    @abc.abstractmethod
    def evaluate(self, state: TrainState, seed: Any, num_episodes: int | None = None) -> tuple[Any, Any]:
        """Play the validation episodes with the deterministic policy.

        Episode i has the same seed in every validation of a training, however many are played, so that two
        validations can be compared episode by episode.

        Args:
            state: The state of the training.
            seed: The seed of the training, from which the episodes' seeds follow.
            num_episodes: The number of episodes, from the first; by default ``num_eval_episodes``.

        Returns:
            The undiscounted return of each episode, float32 ``[num_episodes]``, and whether one was cut at the limit.
        """

    def end_segment(self, state: TrainState) -> TrainState:
        """Add to the state what a checkpoint keeps of the running episodes, after the validation.

        Args:
            state: The state of the training.

        Returns:
            The state to save, or to continue from.
        """
        return state

    def close(self) -> None:  # noqa: B027  (a compiled program holds nothing)
        """Close what the host holds; it is opened again on demand."""


def validation_limit(declared: int | None, config: Config, num_episodes: int) -> int:
    """Return the number of steps after which validation cuts an episode.

    Args:
        declared: The time limit of the environment, if it has one: then this is the result.
        config: The configuration.
        num_episodes: The number of episodes in a validation.

    Returns:
        Where there is no time limit, so many steps that a validation whose episodes never end takes as long as the
        training between two validations, but at least `SHORTEST_CUT` and at most `MAX_EPISODE_STEPS`.
    """
    share = config.total_timesteps // config.num_evals // num_episodes
    return declared or min(max(share, SHORTEST_CUT), MAX_EPISODE_STEPS)


def empty_rollout(num_features: int, distribution: Distribution, config: Config) -> Transition:
    """Return a buffer of zeros for the longest rollout, ``[max_chunks, chunk_steps, num_envs, ...]``."""
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


class JaxRollouts(Rollouts):
    """Environments that are written in JAX, stepped inside the compiled program.

    Args:
        env: The environment.
        config: The static part of the configuration.
        algorithm: The algorithm.
        mesh: The devices that the environments are divided among, if there are several.
    """

    def __init__(self, env: Env, config: Config, algorithm: Algorithm, mesh: Mesh | None = None) -> None:
        declared = getattr(env, "max_episode_steps", None)
        limit = validation_limit(declared, config, config.num_eval_episodes)
        super().__init__(config, algorithm, env.observation_space, limit)
        self.env = env
        self.mesh = mesh

    def compiled(self, function: Callable[..., Any], *, ahead: bool = False) -> Callable[..., Any]:
        """Return the function as it is; see `Rollouts.compiled`."""
        return function

    def cond(self, condition: Any, on_true: Callable[[], Any], on_false: Callable[[], Any]) -> Any:
        """See `Rollouts.cond`."""
        return jax.lax.cond(condition, on_true, on_false)

    def while_loop(self, condition: Callable[[Any], Any], body: Callable[[Any], Any], carry: Any) -> Any:
        """See `Rollouts.while_loop`."""
        return jax.lax.while_loop(condition, body, carry)

    def reset(self, state: TrainState) -> TrainState:
        """See `Rollouts.reset`."""
        key, reset_key = jax.random.split(jax.random.wrap_key_data(state.key))
        keys = jax.random.split(reset_key, self.config.num_envs)
        env_state, observation = jax.vmap(self.env.reset)(keys)
        return state._replace(env_state=env_state, observation=observation, key=jax.random.key_data(key))

    def begin_segment(self, state: TrainState, seed: Any) -> TrainState:
        """Let the episodes continue where they are; see `Rollouts.begin_segment`."""
        return state._replace(episodes=state.episodes.after_report())

    def buffer(self) -> Transition:
        """See `Rollouts.buffer`."""
        rollout = empty_rollout(self.algorithm.num_features, self.algorithm.distribution, self.config)
        return jax.tree.map(lambda a: divide_envs(a, 2, self.mesh), rollout)

    def collect(
        self, state: TrainState, buffer: Transition | None, stage: Any, key: PRNGKeyArray
    ) -> tuple[TrainState, Experience]:
        """See `Rollouts.collect`. Environments are reset only after a step in which an episode ended (`restart`)."""
        env, distribution, sample = self.env, self.algorithm.distribution, self.algorithm.sample
        shape = (self.config.chunk_steps, self.config.num_envs)
        policy, log_std = state.networks.actor.rollout(), state.networks.actor.log_std
        normalize = state.normalizer
        block = block_size(env, self.config.num_envs)

        def one_step(carry: tuple[Any, Array, Episodes], noise: Any) -> tuple[Any, Transition]:
            env_state, observation, episodes = carry
            action_noise, step_keys, reset_keys = noise
            x = normalize(observation)
            action = sample(policy(x), log_std, action_noise)
            env_state, result = jax.vmap(env.step)(step_keys, env_state, distribution.to_env(action))
            done = result.terminated | result.truncated
            transition = Transition(
                x, action, result.reward, result.terminated, result.truncated, normalize(result.observation)
            )
            moved_on = env_state, result.observation

            if self.mesh is None:
                env_state, observation = restart(env, done, reset_keys, moved_on, block)
            else:  # the devices would have to agree on the condition at every step
                env_state, observation = tree_where(done, jax.vmap(env.reset)(reset_keys), moved_on)
            return (env_state, observation, episodes.step(result.reward, done)), transition

        def one_chunk(i: Int[Array, ""], carry: Any) -> Any:
            running, rollout = carry
            # few large draws: each call of jax.random costs a tenth of a second of compiling
            act, world = jax.random.split(jax.random.fold_in(key, i))
            step_keys, reset_keys = jax.random.split(world, (2, *shape))
            noise = (distribution.noise(act, shape), step_keys, reset_keys)
            running, chunk = jax.lax.scan(one_step, running, noise)
            write = jax.lax.dynamic_update_index_in_dim
            return running, jax.tree.map(lambda b, c: write(b, c, i, 0), rollout, chunk)

        running = (state.env_state, state.observation, state.episodes)
        running, rollout = jax.lax.fori_loop(0, 1 << stage, one_chunk, (running, buffer))
        env_state, observation, episodes = running
        state = state._replace(env_state=env_state, observation=observation, episodes=episodes)
        return state, Experience(rollout, normalize(observation), stage)

    def evaluate(
        self, state: TrainState, seed: Any, num_episodes: int | None = None
    ) -> tuple[Float[Array, " episodes"], Bool[Array, ""]]:
        """See `Rollouts.evaluate`."""
        env, distribution, normalize = self.env, self.algorithm.distribution, state.normalizer
        policy, available = state.networks.actor.rollout(), self.config.num_eval_episodes
        num_episodes = available if num_episodes is None else num_episodes
        # keys are drawn for all of them, as the first of few would have others than the first of many
        keys = jax.random.split(purpose_key(seed, "validation"), (2, max(available, num_episodes)))
        reset_keys, step_keys = keys[:, :num_episodes]
        env_state, observation = jax.vmap(env.reset)(reset_keys)

        def running(carry: tuple[Int[Array, ""], Any, Array, Array, Array]) -> Array:
            time, _, _, done, _ = carry
            return ~jnp.all(done) & (time < self.limit)

        def one_step(carry: tuple[Int[Array, ""], Any, Array, Array, Array]) -> Any:
            time, env_state, observation, done, total = carry
            action = distribution.to_env(distribution.mode(policy(normalize(observation))))
            now = jax.vmap(lambda k: jax.random.fold_in(k, time))(step_keys)
            env_state, step = jax.vmap(env.step)(now, env_state, action)
            total = total + jnp.where(done, 0.0, step.reward)
            return time + 1, env_state, step.observation, done | step.terminated | step.truncated, total

        start = (
            jnp.int32(0),
            env_state,
            observation,
            jnp.zeros(num_episodes, bool),
            jnp.zeros(num_episodes),
        )
        *_, done, total = jax.lax.while_loop(running, one_step, start)
        return total, ~jnp.all(done)
