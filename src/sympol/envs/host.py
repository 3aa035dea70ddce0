"""Gymnasium environments, stepped on the host.

Many copies of one environment, one after the other in this process (on few cores that is faster than workers
are), behind the same `Step` that an environment in JAX answers with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, SupportsFloat

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from jaxtyping import Bool, Float32, Int64, Shaped
from numpy import ndarray

from ..types import Step
from .capabilities import nth_episode_seed
from .errors import EnvironmentFailure
from .spaces import LARGEST, Features, describe, native_actions


def require_finite(what: str, values: Float32[ndarray, "envs ..."]) -> None:
    """Refuse NaN and infinity.

    Args:
        what: The name of the values, for the message.
        values: The values of each environment.

    Raises:
        EnvironmentFailure: A value is not finite; the message names the environment.
    """
    if np.isfinite(values).all():
        return
    index = np.argwhere(~np.isfinite(values))[0][0]
    raise EnvironmentFailure(
        f"environment {index} returned {what} that is not finite in float32: {values[index]}"
    )


def require_held(what: str, observations: Float32[ndarray, "envs features"], names: Sequence[str]) -> None:
    """Refuse observations that are not finite, or too large to be scaled in float32.

    Args:
        what: The name of the observations, for the message.
        observations: The observation of each environment.
        names: The names of the features.

    Raises:
        EnvironmentFailure: A feature breaks the rule; the message names it and the environment.
    """
    if (np.abs(observations) <= LARGEST).all():
        return
    require_finite(what, observations)
    index, feature = map(int, np.argwhere(np.abs(observations) > LARGEST)[0])
    raise EnvironmentFailure(
        f"environment {index} returned {what} with {names[feature]} = {observations[index, feature]:g}; "
        f"{too_large([names[feature]])}"
    )


def too_large(names: Sequence[str]) -> str:
    """Return the part of a message that says what to do about features beyond `LARGEST`.

    Args:
        names: The names of the features.

    Returns:
        The rule and the remedy.
    """
    return (
        f"{', '.join(names)} must be at most {LARGEST:.2g} in magnitude, as larger numbers cannot be scaled in "
        "float32: give it in a larger unit, or its logarithm (gymnasium.wrappers.TransformObservation)"
    )


class StepResult(NamedTuple):
    """The answer of one Gymnasium environment to an action, without its ``info``."""

    observation: Any
    reward: float
    terminated: bool
    truncated: bool


def begin(env: gymnasium.Env, who: str = "", **options: Any) -> Any:
    """Start an episode of one environment.

    Args:
        env: The environment.
        who: Its name in messages, by default that of its class.
        options: Arguments of its ``reset``.

    Returns:
        The first observation, as the environment gave it.

    Raises:
        EnvironmentFailure: It raised an error, such as a TypeError, or did not return ``(observation, info)``.
    """
    try:
        answer: Any = env.reset(**options)
        if not isinstance(answer, tuple) or len(answer) != 2:
            raise TypeError(
                f"reset() must return (observation, info), got {describe(answer)}; the older Gym interface has the "
                "observation alone: return an empty dict beside it"
            )
    except Exception as error:
        raise _failure(env, who, "reset()", error) from error
    return answer[0]


def advance(env: gymnasium.Env, action: Any, who: str = "") -> StepResult:
    """Take one step in one environment.

    A reward or flag may also be an array that holds one number, such as one of shape (1,).

    Args:
        env: The environment.
        action: The action, as the environment takes it.
        who: Its name in messages, by default that of its class.

    Returns:
        The result.

    Raises:
        EnvironmentFailure: It raised an error, such as a TypeError, or did not return
            ``(observation, reward, terminated, truncated, info)``.
    """
    try:
        answer: Any = env.step(action)
        if not isinstance(answer, tuple) or len(answer) != 5:
            values = f"{len(answer)} values" if isinstance(answer, tuple) else describe(answer)
            raise TypeError(
                f"step() must return (observation, reward, terminated, truncated, info), got {values}; the older Gym "
                "interface has one flag, done: say whether the task itself ended (terminated) or only the time was up "
                "(truncated)"
            )
        observation, reward, terminated, truncated, _ = answer
        return StepResult(
            observation,
            float(_single("reward", "a number", reward)),
            bool(_single("terminated", "true or false", terminated)),
            bool(_single("truncated", "true or false", truncated)),
        )
    except Exception as error:
        raise _failure(env, who, f"step({action!r})", error) from error


def _failure(env: gymnasium.Env, who: str, where: str, error: Exception) -> EnvironmentFailure:
    who = who or type(env.unwrapped).__name__
    hint = ""
    if isinstance(error, ValueError) and "to unpack" in str(error):  # by a wrapper, such as TimeLimit
        hint = (
            "; if the environment has the older Gym interface: reset() must return (observation, info), and step() "
            "(observation, reward, terminated, truncated, info)"
        )
    return EnvironmentFailure(f"{who} failed in {where}: {type(error).__name__}: {error}{hint}")


def _single(what: str, kind: str, value: Any) -> Any:
    """Return the one number that a value is or holds."""
    if isinstance(value, bool | int | float):
        return value
    try:
        array = np.asarray(value)
        number = array.item() if array.size == 1 else None
        if isinstance(number, SupportsFloat):
            return number
    except ValueError:  # ragged
        pass
    raise TypeError(f"{what} must be {kind}, got {describe(value)}")


class HostEnvs:
    """Copies of a Gymnasium environment, reset by themselves when an episode ends.

    Args:
        make: A function that makes a copy.
        num_envs: The number of copies.
        features: The description of the observation space.

    Raises:
        EnvironmentFailure: The first copy can be made and a later one cannot; those made before are closed.
        ValueError: The function returns the same object each time.
    """

    def __init__(self, make: Callable[[], gymnasium.Env], num_envs: int, features: Features):
        self._names = features.names
        makers = [_Maker(make, index, features) for index in range(num_envs)]
        try:
            self._envs = SyncVectorEnv(makers, copy=False, autoreset_mode=AutoresetMode.SAME_STEP)
        except BaseException:
            for maker in makers:
                maker.close()
            raise
        self._copies: Any = self._envs.envs
        if len({id(copy.env) for copy in self._copies}) < num_envs:
            raise ValueError(
                f"num_envs must be 1, got {num_envs}: the function that makes the environment returns the same object "
                "each time; let it make a new one"
            )

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return self._envs.num_envs

    @property
    def was_cut(self) -> bool:
        """True where `step` has cut an episode at its ``max_steps`` since `reset`."""
        return any(copy.was_cut for copy in self._copies)

    @property
    def episode(self) -> Int64[ndarray, " envs"]:
        """The number of the episode that each copy plays."""
        return np.array([copy.episode for copy in self._copies])

    def reset(self, seed: int, num_episodes: int | None = None) -> Float32[ndarray, "envs features"]:
        """Start the episode in every copy whose number is that of the copy; see `VectorEnvs.reset`.

        Args:
            seed: The seed that all episodes' seeds are derived from.
            num_episodes: How many episodes there are; by default there is no end of them.

        Returns:
            The first observations; of copies without an episode, zeros.

        Raises:
            EnvironmentFailure: A copy raised an error, or returned NaN or infinity.
        """
        for index, copy in enumerate(self._copies):
            copy.was_cut = False
            copy.plan = _Plan(seed, index, self.num_envs, num_episodes)
        observation, _ = self._envs.reset()
        require_held("an observation", observation, self._names)
        return observation.copy()

    def step(
        self,
        actions: Shaped[ndarray, "envs ..."],
        wanted: Bool[ndarray, " envs"] | None = None,
        max_steps: int | None = None,
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, or in those that are wanted.

        Args:
            actions: The policy's actions: int32 ``[E]`` or ``[E, k]`` counted from zero, or float32 ``[E, A]`` or
                ``[E, *shape]`` within the bounds.
            wanted: Which copies to step; rows of the others in the result have no meaning. All by default.
            max_steps: The number of steps after which an episode that does not end by itself is truncated.

        Returns:
            The step, with the true last observation of every episode that ended, and the observations that the next
            actions answer to: after an end, the first of a new episode.

        Raises:
            EnvironmentFailure: A copy raised an error, or returned NaN or infinity.
        """
        actions = native_actions(self._envs.single_action_space, actions)
        for index, copy in enumerate(self._copies):
            copy.max_steps, copy.rests = max_steps, wanted is not None and not wanted[index]
        observation, reward, terminated, truncated, info = self._envs.step(actions)
        next_observation = observation.copy()
        last_observation = observation.copy()
        for index in np.flatnonzero(terminated | truncated):
            last_observation[index] = info["final_obs"][index]
        reward = reward.astype(np.float32)
        require_held("an observation", last_observation, self._names)
        require_held("a first observation of an episode", next_observation, self._names)
        require_finite("a reward", reward)
        step: Any = last_observation, reward, terminated, truncated  # NumPy's arrays, not JAX's
        return Step(*step), next_observation

    def close(self) -> None:
        """Close every copy."""
        self._envs.close()


class _Maker:
    """The maker of one copy, which returns flat features and names its index in messages."""

    def __init__(self, make: Callable[[], gymnasium.Env], index: int, features: Features):
        self.make, self.index, self.features = make, index, features
        self.made: gymnasium.Env | None = None

    def __call__(self) -> gymnasium.Env:
        try:
            self.made = _FlatEnv(self.make(), self.index, self.features)
        except Exception as error:
            if self.index == 0:
                raise
            raise EnvironmentFailure(
                f"num_envs must be at most {self.index}, as copy {self.index + 1} of the environment cannot be made "
                f"beside the others: {type(error).__name__}: {error}"
            ) from error
        return self.made

    def close(self) -> None:
        if self.made is not None:
            self.made.close()


class _Plan:
    """The episodes that one copy plays."""

    def __init__(self, seed: int, index: int, num_envs: int, num_episodes: int | None) -> None:
        self._seed, self._num_envs, self._num_episodes = seed, num_envs, num_episodes
        self._next = self.episode = index

    def next_seed(self) -> int | None:
        """Return the seed of the next episode, or None after the last."""
        self.episode, self._next = self._next, self._next + self._num_envs
        if self._num_episodes is not None and self.episode >= self._num_episodes:
            return None
        return nth_episode_seed(self._seed, self.episode)


class _FlatEnv(gymnasium.Wrapper):
    """Flattens the observation, into a new array: an environment may reuse its own at the next reset.

    Its ``info`` goes no further: Gymnasium would make one array of what all copies say, which need not fit together.
    An episode is truncated after ``max_steps`` steps; while the copy ``rests``, a step does nothing.
    """

    def __init__(self, env: gymnasium.Env, index: int, features: Features):
        super().__init__(env)
        self.who, self.features = f"environment {index}", features
        self.observation_space = Box(features.low, features.high, dtype=np.float32)
        self.max_steps: int | None = None
        self.was_cut, self.rests = False, False
        self.plan = _Plan(0, index, index + 1, None)
        self._steps, self._last = 0, np.zeros(len(features.names), np.float32)

    @property
    def episode(self) -> int:
        return self.plan.episode

    def reset(self, **_: Any) -> tuple[Float32[ndarray, " features"], dict[str, Any]]:
        seed = self.plan.next_seed()
        if seed is not None:
            self._steps, self._last = 0, self._flatten(begin(self.env, self.who, seed=seed))
        return self._last, {}

    def step(self, action: Any) -> tuple[Float32[ndarray, " features"], float, bool, bool, dict[str, Any]]:
        if self.rests:
            return self._last, 0.0, False, False, {}
        observation, reward, terminated, truncated = advance(self.env, action, self.who)
        self._steps, self._last = self._steps + 1, self._flatten(observation, action)
        if self.max_steps is not None and self._steps >= self.max_steps:
            self.was_cut = self.was_cut or not (terminated or truncated)
            truncated = truncated or not terminated
        return self._last, reward, terminated, truncated, {}

    def _flatten(self, observation: Any, *after: Any) -> Float32[ndarray, " features"]:
        try:
            flat = self.features.flatten(observation)
            if flat.ndim != 1:
                raise ValueError(f"observation must be a single one, got a batch of shape {flat.shape[:-1]}")
        except Exception as error:
            where = f"step({after[0]!r})" if after else "reset()"
            raise _failure(self.env, self.who, where, error) from error
        return flat
