"""Gymnasium's vector environments, in all three ways of resetting, behind `sympol.envs.capabilities.VectorEnvs`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from jaxtyping import Bool, Float32, Int64, Shaped
from numpy import ndarray

from ..types import Step
from .errors import EnvironmentFailure
from .host import require_finite, require_held
from .seeds import nth_episode_seed
from .spaces import Features, native_actions


class FirstCopy(gymnasium.Env):
    """The first copy of a vector environment as an environment of its own; the others are stepped along with it.

    Args:
        vector: The vector environment.
    """

    def __init__(self, vector: VectorEnv) -> None:
        self.vector = vector
        self.observation_space, self.action_space = (
            vector.single_observation_space,
            vector.single_action_space,
        )
        self.spec = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every copy, and return the first one's observation."""
        observation, _ = self.vector.reset(seed=seed)
        return _row(observation, 0), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take the action in every copy, and return the first one's answer."""
        actions = np.stack([np.asarray(action)] * self.vector.num_envs)
        observation, reward, terminated, truncated, info = self.vector.step(actions)
        ended = bool(terminated[0] or truncated[0])
        if autoreset_mode(self.vector) is AutoresetMode.DISABLED:
            over = np.asarray(terminated) | np.asarray(truncated)
            if over[1:].any() and not ended:  # the others may not be stepped any further
                over[0] = False
                self.vector.reset(options={"reset_mask": over})
        last = info["final_obs"] if ended and "final_obs" in info else observation
        return _row(last, 0), float(reward[0]), bool(terminated[0]), bool(truncated[0]), {}

    def close(self) -> None:
        """Close the vector environment."""
        self.vector.close()


def autoreset_mode(vector: VectorEnv) -> AutoresetMode:
    """Return how a vector environment resets its copies.

    Args:
        vector: The vector environment.

    Returns:
        The mode in its metadata; without one, that of Gymnasium's own, ``NEXT_STEP``.
    """
    return AutoresetMode(
        (getattr(vector, "metadata", None) or {}).get("autoreset_mode", AutoresetMode.NEXT_STEP)
    )


class GymnasiumVectorEnvs:
    """A vector environment of Gymnasium's.

    Its copies restart by themselves, so only the episodes that begin with `reset` have a seed of their own, and no
    episode can be replayed. Where the number of episodes is given, all copies begin together and those that have ended
    wait for the others, so that every episode does have one.

    Args:
        vector: The vector environment.
        features: The description of a single observation.
        close: What closes it; nothing for the user's own object.
    """

    replays = False
    workers = None

    def __init__(
        self, vector: VectorEnv, features: Features, close: Callable[[], Any] = lambda: None
    ) -> None:
        self._vector, self._features, self._close = vector, features, close
        self._mode, self._who = autoreset_mode(vector), type(vector.unwrapped).__name__
        num_envs = vector.num_envs
        self._episode, self._length = np.arange(num_envs), np.zeros(num_envs, int)
        self._seed, self._num_episodes, self.was_cut = 0, None, False
        self._resets_next = np.zeros(num_envs, bool)
        self._waits = np.zeros(num_envs, bool)
        self._following = np.zeros((num_envs, len(features.names)), np.float32)
        self.skipped: Bool[ndarray, " envs"] | None = None

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return self._vector.num_envs

    @property
    def episode(self) -> Int64[ndarray, " envs"]:
        """The number of the episode that each copy plays, or waits for."""
        return self._episode.copy()

    def reset(
        self, seed: int, num_episodes: int | None = None, episodes: Int64[ndarray, " envs"] | None = None
    ) -> Float32[ndarray, "envs features"]:
        """Begin an episode in every copy; see `VectorEnvs.reset`.

        Raises:
            EnvironmentFailure: The environment raised an error, or returned NaN or infinity.
        """
        self._seed, self._num_episodes, self.was_cut = seed, num_episodes, False
        self._episode = np.arange(self.num_envs) if episodes is None else np.array(episodes)
        return self._begin().copy()

    def step(
        self,
        actions: Shaped[ndarray, "envs ..."],
        wanted: Bool[ndarray, " envs"] | None = None,
        max_steps: int | None = None,
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, in those that are not ``wanted``, too; see `VectorEnvs.step`.

        ``skipped`` then tells the copies for which it was no step but a reset, under `AutoresetMode.NEXT_STEP`.

        Raises:
            EnvironmentFailure: The environment raised an error, or returned NaN or infinity.
        """
        native = native_actions(self._vector.single_action_space, actions)
        observation, reward, terminated, truncated, info = self._call("step()", self._vector.step, native)
        following = self._flatten(observation)
        terminated, truncated = np.array(terminated, bool), np.array(truncated, bool)
        reward = np.array(reward, np.float32)
        skipped, ended = self._resets_next, terminated | truncated
        last = following.copy()
        self._resets_next = np.zeros(self.num_envs, bool)
        if self._mode is AutoresetMode.NEXT_STEP:
            self._resets_next = ended.copy()
            self._length[skipped] = -1
        elif ended.any() and self._mode is AutoresetMode.SAME_STEP:
            for index in np.flatnonzero(ended).tolist():
                last[index] = self._features.flatten(_row(info["final_obs"], index))
        elif ended.any():
            begun, _ = self._call("reset()", self._vector.reset, options={"reset_mask": ended})
            following = np.where(ended[:, None], self._flatten(begun), following)
        self.skipped = skipped if skipped.any() else None
        self._length += 1
        if max_steps is not None:
            cut = (self._length >= max_steps) & ~ended & ~self._waits
            truncated, self.was_cut = truncated | cut, self.was_cut or bool(cut.any())
        require_held("an observation", last, self._features.names)
        require_finite("a reward", reward)
        ended = terminated | truncated
        self._length[ended] = 0
        if self._num_episodes is None:
            self._episode[ended] += self.num_envs
        else:
            ended &= ~self._waits
            for array in (reward, terminated, truncated):
                array[self._waits] = 0
            self._episode[ended] += self.num_envs
            self._waits |= ended
            if (self._waits | (self._episode >= self._num_episodes)).all() and (
                self._episode < self._num_episodes
            ).any():
                following = self._begin()
        require_held("a first observation of an episode", following, self._features.names)
        self._following = following
        step: Any = last, reward, terminated, truncated
        return Step(*step), following.copy()

    def close(self) -> None:
        """Close the vector environment, unless it is the user's own object."""
        self._close()

    def _begin(self) -> Float32[ndarray, "envs features"]:
        seed = nth_episode_seed(self._seed, int(self._episode[0]))
        observation, _ = self._call("reset()", self._vector.reset, seed=seed)
        self._waits[:] = self._resets_next[:] = False
        self._length[:] = 0
        self._following = self._flatten(observation)
        require_held("an observation", self._following, self._features.names)
        return self._following

    def _flatten(self, observation: Any) -> Float32[ndarray, "envs features"]:
        flat = self._call("an observation", self._features.flatten, observation)
        if flat.shape != self._following.shape:
            raise EnvironmentFailure(
                f"{self._who} returned observations of shape {flat.shape}, which must be {self._following.shape}"
            )
        return flat

    def _call(self, where: str, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        try:
            return function(*arguments, **options)
        except Exception as error:
            raise EnvironmentFailure(
                f"{self._who} failed in {where}: {type(error).__name__}: {error}"
            ) from error


def single_maker(vector: VectorEnv) -> Callable[[], gymnasium.Env] | None:
    """Return a function that makes a single one of the environments in a vector environment.

    Args:
        vector: The vector environment.

    Returns:
        The function, or None where neither a spec nor the functions of `SyncVectorEnv` tell.
    """
    makers = getattr(vector.unwrapped, "env_fns", None)
    wrapped = vector is not vector.unwrapped
    if makers and not wrapped:
        return makers[0]
    spec = vector.spec
    if spec is None or wrapped or spec.id not in gymnasium.registry:
        return None
    kwargs = {
        name: value
        for name, value in spec.kwargs.items()
        if name not in ("num_envs", "vectorization_mode", "vector_kwargs", "wrappers")
    }

    def make() -> gymnasium.Env:
        return gymnasium.make(spec.id, disable_env_checker=True, **kwargs)

    try:
        example = make()
    except Exception:
        return None
    same = (
        example.observation_space == vector.single_observation_space
        and example.action_space == vector.single_action_space
    )
    example.close()
    return make if same else None


def _row(observations: Any, index: int) -> Any:
    """Return one observation of a batch: of an array, a tuple or a dictionary of arrays, or an array of objects."""
    if isinstance(observations, dict):
        return {key: _row(part, index) for key, part in observations.items()}
    if isinstance(observations, tuple):
        return tuple(_row(part, index) for part in observations)
    return observations[index]
