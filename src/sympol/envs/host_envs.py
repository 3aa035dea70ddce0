"""Copies of a Gymnasium environment behind the interface `sympol.envs.capabilities.VectorEnvs`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Bool, Float32, Int64, Shaped
from numpy import ndarray

from ..trees.floats import flushed
from ..types import Step
from .capabilities import VectorEnvs
from .copy_group import Buffers, CopyGroup
from .env_workers import WorkerGroup, WorkerPool
from .host import require_finite, require_held
from .spaces import Features, native_actions


class HostEnvs:
    """Copies of a Gymnasium environment, reset by themselves when an episode ends.

    Args:
        make: A function that makes a copy.
        num_envs: The number of copies.
        features: The description of the observation space.
        action_space: The action space.
        workers: The processes that step the copies; by default this process does.

    Raises:
        EnvironmentFailure: The first copy can be made and a later one cannot; those made before are closed.
        ValueError: The function returns the same object each time.
    """

    replays = True
    skipped = None

    def __init__(
        self,
        make: Callable[[], gymnasium.Env],
        num_envs: int,
        features: Features,
        action_space: gymnasium.Space,
        workers: WorkerPool | None = None,
    ) -> None:
        self._names, self._action_space = features.names, action_space
        self.workers = workers
        if workers is not None:
            self._group = WorkerGroup(make, num_envs, features, action_space, workers)
            self._buffers = self._group.buffers
        else:
            layout = Buffers.layout(num_envs, features, action_space)
            self._buffers = Buffers(**{name: np.zeros(*array) for name, array in layout.items()})
            self._group = CopyGroup(make, 0, num_envs, features, self._buffers)

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return len(self._buffers.reward)

    @property
    def was_cut(self) -> bool:
        """True where `step` has cut an episode at its ``max_steps`` since `reset`."""
        return bool(self._buffers.was_cut.any())

    @property
    def episode(self) -> Int64[ndarray, " envs"]:
        """The number of the episode that each copy plays."""
        return self._buffers.episode.copy()

    def reset(
        self, seed: int, num_episodes: int | None = None, episodes: Int64[ndarray, " envs"] | None = None
    ) -> Float32[ndarray, "envs features"]:
        """Begin an episode in every copy; see `VectorEnvs.reset`.

        Args:
            seed: The seed that all episodes' seeds are derived from.
            num_episodes: How many episodes there are; by default there is no end of them.
            episodes: The number of the episode that each copy begins, -1 where it continues its own; by default
                the number of the copy.

        Returns:
            The observations that the next actions answer to; of copies without an episode, zeros.

        Raises:
            EnvironmentFailure: A copy raised an error, or returned NaN or infinity.
        """
        numbers = np.arange(self.num_envs) if episodes is None else episodes
        goes_on, before = numbers < 0, self._buffers.episode.copy()
        self._buffers.episode[:] = numbers
        self._group.reset(seed, num_episodes)
        self._buffers.episode[goes_on] = before[goes_on]
        observation = flushed(self._buffers.following)
        require_held("an observation", observation, self._names)
        return observation

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
        buffers = self._buffers
        buffers.actions[:] = native_actions(self._action_space, actions)
        buffers.wanted[:] = True if wanted is None else wanted
        self._group.step(max_steps)
        last_observation = flushed(buffers.last)
        terminated, truncated = buffers.terminated.copy(), buffers.truncated.copy()
        continues = wanted is None and not (terminated.any() or truncated.any())
        next_observation = last_observation.copy() if continues else flushed(buffers.following)
        with np.errstate(over="ignore"):
            reward = buffers.reward.astype(np.float32)
        require_held("an observation", last_observation, self._names)
        if not continues:
            require_held("a first observation of an episode", next_observation, self._names)
        require_finite("a reward", reward)
        step: Any = last_observation, reward, terminated, truncated
        return Step(*step), next_observation  # NumPy's arrays, not JAX's

    def shares_with(self, other: VectorEnvs) -> bool:
        """Return whether a copy is also one of others, where a function returns the same object each time.

        Args:
            other: The others.

        Returns:
            True if one is.
        """
        others = other._group.envs if isinstance(other, HostEnvs) else []
        return not {id(env) for env in self._group.envs}.isdisjoint(map(id, others))

    def close(self) -> None:
        """Close every copy."""
        self._group.close()


class OwnedHostEnvs(HostEnvs):
    """Copies whose worker processes end with them."""

    def close(self) -> None:
        """Close every copy, and end the processes."""
        super().close()
        if self.workers is not None:
            self.workers.close()
