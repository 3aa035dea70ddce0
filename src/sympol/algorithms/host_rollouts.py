"""Experience from environments that the host steps; the policy samples in one compiled call a step."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float32, Int, PRNGKeyArray

from ..envs.errors import EnvironmentFailure
from ..envs.spec import EnvSpec
from ..policies.actor import Actor
from ..types import Transition
from .algorithm import Algorithm, Experience
from .compiled import Compiled
from .config import Config
from .initialization import host_seed
from .replay import (
    ActionHistory,
    EpisodesRestarted,
    FrozenHistory,
    RunningEpisodes,
    first_episodes,
    longest_replay,
    replay,
)
from .rollouts import Rollouts, validation_limit
from .state import Episodes, Normalizer, TrainState

FEWEST_EPISODES = 4
"""Episodes of a validation however long they take (`Config.eval_share`)."""


class HostRollouts(Rollouts):
    """Copies of an environment that are stepped through Gymnasium's API or in native code.

    Training episodes live on while other copies are validated on, and after a resume `sympol.algorithms.replay` leads
    back into them. Where there is only one copy, validation interrupts its episode and training begins a new one. The
    environments are opened when they are first needed.

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
        self._validation_envs: Any = None
        self._seed = 0
        distribution = algorithm.distribution
        outputs = np.zeros((config.num_envs, distribution.num_outputs), np.float32)
        action = jax.eval_shape(lambda x: distribution.to_env(distribution.mode(x)), outputs)
        actions = np.zeros(action.shape, action.dtype)
        self._no_episodes = RunningEpisodes.none(actions, algorithm.num_features)
        self._longest = longest_replay(spec.max_episode_steps, actions)
        self._history: ActionHistory | None = None
        """The running episodes' actions; None until they have begun, or been replayed."""
        self._running = self._no_episodes
        """The running episodes at the end of the last segment."""
        self._was_loaded = False
        """Whether ``_running`` came from elsewhere, such as a checkpoint."""
        self._transition: Transition | None = None
        """The last step."""
        self._is_live = False
        """Whether the copies are in the episodes of ``_running``."""
        self._latest: tuple[TrainState, FrozenHistory] | None = None
        self._observation = np.zeros((config.num_envs, algorithm.num_features), np.float32)

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
            state: TrainState,
            rollout: Transition,
            observation: Array,
            stage: Int[Array, ""],
            counts: Bool[Array, "chunks steps envs"] | None,
        ) -> tuple[TrainState, Experience]:
            done = rollout.terminated | rollout.truncated

            def counted(i: Any, episodes: Episodes) -> Episodes:
                return episodes.steps(rollout.reward[i], done[i], None if counts is None else counts[i])

            episodes = jax.lax.fori_loop(0, 1 << stage, counted, state.episodes)
            normalize = state.normalizer
            rollout = rollout._replace(
                observation=normalize(rollout.observation),
                last_observation=normalize(rollout.last_observation),
            )
            return state._replace(episodes=episodes), Experience(rollout, normalize(observation), stage)

        @jax.jit
        def without_running(state: TrainState, restarted: Array) -> TrainState:
            episodes = state.episodes
            return state._replace(
                episodes=episodes._replace(
                    running_return=jnp.where(restarted, 0, episodes.running_return),
                    running_length=jnp.where(restarted, 0, episodes.running_length),
                )
            )

        self._for_acting, self._draw, self._act, self._decide = for_acting, draw, act, decide
        self._scaled, self._without_running = scaled, without_running

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
                self._latest = carry[0], self._frozen()
        return carry

    @property
    def latest(self) -> TrainState | None:
        """See `Rollouts.latest`."""
        if self._latest is None:
            return None
        state, frozen = self._latest
        return state._replace(env_state=frozen.running(self._no_episodes))

    def reset(self, state: TrainState) -> TrainState:
        """Let all episodes begin with the first rollout; see `Rollouts.reset`."""
        return state._replace(env_state=self._no_episodes)

    def begin_segment(self, state: TrainState, seed: Any) -> TrainState:
        """Let the episodes continue where they are; see `Rollouts.begin_segment`."""
        self._latest, self._seed = None, int(seed)
        if state.env_state is not self._running:
            self._running, self._is_live, self._was_loaded = state.env_state, False, True
        elif self._is_live and (too_long := self._running.length < 0).any():
            state = self._begin_anew(state, too_long)
        return state._replace(env_state=self._no_episodes, episodes=state.episodes.after_report())

    def end_segment(self, state: TrainState) -> TrainState:
        """See `Rollouts.end_segment`."""
        if self._is_live:
            running = self._frozen().running(self._no_episodes)
            # what cannot be replayed is not saved: a resume begins new episodes
            self._running = running if self._open().replays else RunningEpisodes(*self._no_episodes)
        return state._replace(env_state=self._running)

    def _frozen(self) -> FrozenHistory:
        assert self._history is not None
        return self._history.freeze(self._open().episode, self._observation)

    def _begin_anew(self, state: TrainState, which: Bool[np.ndarray, " envs"]) -> TrainState:
        """Begin the next episode in some copies, as a resume would."""
        running, num_envs = self._running, self.config.num_envs
        episode = first_episodes(num_envs, running.num_before + 1)
        with _with_step(int(state.timestep), "on a new start"):
            seed = host_seed(self._seed, "train")
            self._observation = self._open().reset(seed, episodes=np.where(which, episode, -1))
        self._history = ActionHistory(
            num_envs, self._longest, np.where(which, 0, running.length), running.actions
        )
        return self._without_running(state, which)

    def _enter_episodes(self, state: TrainState) -> TrainState:
        """Begin new episodes, or continue in those that were running when the state was saved."""
        envs, running, timestep = self._open(), self._running, int(state.timestep)
        num_envs, seed = self.config.num_envs, host_seed(self._seed, "train")
        if len(running.length):
            with _with_step(timestep, "replaying the running episodes"):
                self._observation, restarted = replay(envs, seed, running)
            length = np.where(restarted, 0, running.length)
            self._history = ActionHistory(num_envs, self._longest, length, running.actions)
        else:
            if self._was_loaded and int(state.iteration) and not envs.replays:
                warnings.warn(
                    f"{num_envs} training episodes begin anew: those of a vector environment cannot be replayed, so "
                    "this training differs from one without an interruption",
                    EpisodesRestarted,
                    stacklevel=2,
                )
            # no copy has played as many episodes as there were steps
            episode, restarted = first_episodes(num_envs, timestep), np.ones(num_envs, bool)
            with _with_step(timestep, "on a new start"):
                self._observation = envs.reset(seed, episodes=episode)
            self._history = ActionHistory(num_envs, self._longest)
        self._was_loaded = False
        return self._without_running(state, restarted)

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
        if not self._is_live:
            state, self._is_live = self._enter_episodes(state), True
        history, counts = self._history, None
        assert history is not None
        policy, log_std = self._for_acting(state.networks.actor), state.networks.actor.log_std
        for i in range(config.chunk_steps << int(stage)):
            chunk, step_of_chunk = divmod(i, config.chunk_steps)
            if step_of_chunk == 0:
                noise = np.asarray(self._draw(key, np.int32(chunk)))
            observation = self._observation
            action, env_action = self._act(
                policy, log_std, state.normalizer, noise[step_of_chunk], observation
            )
            actions = np.asarray(env_action)
            with _with_step(timestep + i * config.num_envs):
                step, self._observation = envs.step(actions)
            history.append(actions, np.asarray(step.terminated | step.truncated))
            arrays: Any = (observation, np.asarray(action), *step[1:], step.observation)
            transition = Transition(*arrays)
            if envs.skipped is not None:  # a reset is no experience: the row repeats the end of the episode
                if counts is None:
                    counts = np.ones((1 << config.max_stage, config.chunk_steps, config.num_envs), bool)
                counts[chunk, step_of_chunk] = ~envs.skipped
                transition = _where(envs.skipped, self._transition or transition, transition)
            self._transition = transition
            if rollout is None:
                rollout = self._rollout_like(transition)
            for array, row in zip(rollout, transition, strict=True):
                array[chunk, step_of_chunk] = row  # pyright: ignore[reportIndexIssue]
        history.end_rollout()
        return self._scaled(state, rollout, self._observation, stage, counts)

    def evaluate(
        self, state: TrainState, seed: Any, num_episodes: int | None = None
    ) -> tuple[Float32[np.ndarray, " episodes"], bool]:
        """See `Rollouts.evaluate`. An episode that reaches `limit` is cut there, and its copy begins the next one."""
        with _with_step(int(state.timestep), "in validation"):
            return self._play(state, int(seed), num_episodes or self._affordable(state))

    def _affordable(self, state: TrainState) -> int:
        """Return how many episodes a validation may play, going by the length of those since the last one."""
        config, episodes = self.config, state.episodes
        if not config.eval_share:
            return config.num_eval_episodes
        ended = int(episodes.num_ended)
        if not ended and state.guide is not None:
            length = float(state.guide.tree_length)
        else:
            length = int(episodes.sum_length) / ended if ended else self.limit
        steps = config.eval_share * config.total_timesteps / config.num_evals
        return min(max(int(steps / length), FEWEST_EPISODES), config.num_eval_episodes)

    def _play(
        self, state: TrainState, seed: int, num_episodes: int
    ) -> tuple[Float32[np.ndarray, " episodes"], bool]:
        envs, returns = self._open_validation(), np.zeros(num_episodes)
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
        for envs in (self._envs, self._validation_envs):
            if envs is not None:
                envs.close()
        self._envs = self._validation_envs = None
        self._is_live = False

    def _open(self) -> Any:
        if self._envs is None:
            self._envs = self._spec.host_envs(self.config.num_envs)
        return self._envs

    def _open_validation(self) -> Any:
        """Return copies to validate on; where there are no others, those of the training, whose episodes are lost."""
        if self._validation_envs is None:
            most = min(self.config.num_envs, self.config.num_eval_episodes)
            self._validation_envs = self._spec.validation_envs(most, self._open())
        if self._validation_envs is not None:
            return self._validation_envs
        self._running, self._is_live = self._no_episodes, False
        return self._open()

    def _rollout_like(self, transition: Transition) -> Transition:
        """Return zeros for the longest rollout; pages that are never written take no memory."""
        axes = (1 << self.config.max_stage, self.config.chunk_steps)
        return jax.tree.map(lambda a: np.zeros((*axes, *np.shape(a)), np.asarray(a).dtype), transition)


def _where(condition: Bool[np.ndarray, " envs"], if_true: Transition, if_false: Transition) -> Transition:
    def choose(a: Any, b: Any) -> Any:
        return np.where(condition.reshape(-1, *(1,) * (np.ndim(a) - 1)), a, b)

    return Transition(*(choose(a, b) for a, b in zip(if_true, if_false, strict=True)))


@contextlib.contextmanager
def _with_step(timestep: int, where: str = "") -> Iterator[None]:
    """Name the training step in the message of an EnvironmentFailure."""
    try:
        yield
    except EnvironmentFailure as failure:
        place = f"{timestep:,}, {where}" if where else f"{timestep:,}"
        raise EnvironmentFailure(f"at training step {place}: {failure}") from failure
