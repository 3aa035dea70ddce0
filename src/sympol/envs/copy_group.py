"""Copies of a Gymnasium environment that one process steps, one after the other.

Everything they answer is written into `Buffers`, which may lie in memory that is shared with another process. This
module imports no JAX, so that a process that only steps environments does not either.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Bool, Float64, Int64, Shaped
from numpy import ndarray

from ..trees.groups import require_one_hot
from .errors import EnvironmentFailure
from .flat_rows import row_writer
from .host import advance, begin, failure
from .seeds import nth_episode_seed
from .spaces import Features


@dataclass(frozen=True)
class Buffers:
    """The memory that copies are told and answer through, one row a copy.

    Attributes:
        actions: The actions, as the environment takes them.
        wanted: Which copies to step.
        episode: The number of the episode that each plays; on a reset the one to begin, or -1.
        last: The observation after the step, the true last one of an episode that ended.
        following: The observation that the next action answers to.
        reward: The reward of the step.
        terminated: Whether the task itself ended with it.
        truncated: Whether a time limit ended the episode with it.
        was_cut: Whether an episode has been cut at ``max_steps`` since the reset.
    """

    actions: Shaped[ndarray, "envs ..."]
    wanted: Bool[ndarray, " envs"]
    episode: Int64[ndarray, " envs"]
    last: Float64[ndarray, "envs features"]
    following: Float64[ndarray, "envs features"]
    reward: Float64[ndarray, " envs"]
    terminated: Bool[ndarray, " envs"]
    truncated: Bool[ndarray, " envs"]
    was_cut: Bool[ndarray, " envs"]

    @staticmethod
    def layout(
        num_envs: int, features: Features, action_space: gymnasium.Space
    ) -> dict[str, tuple[Any, Any]]:
        """Return the shape and the type of every array.

        Args:
            num_envs: The number of copies.
            features: The description of the observation space.
            action_space: The action space.

        Returns:
            The shapes and types, by the names of the arrays.
        """
        flat = ((num_envs, len(features.names)), np.dtype(np.float64))
        flag = ((num_envs,), np.dtype(bool))
        return {
            "actions": ((num_envs, *(action_space.shape or ())), np.dtype(action_space.dtype)),
            "wanted": flag,
            "episode": ((num_envs,), np.dtype(np.int64)),
            "last": flat,
            "following": flat,
            "reward": ((num_envs,), np.dtype(np.float64)),
            "terminated": flag,
            "truncated": flag,
            "was_cut": flag,
        }

    def rows(self, begin: int, end: int) -> Buffers:
        """Return the rows of some copies, in the same memory.

        Args:
            begin: The first copy.
            end: The copy after the last.

        Returns:
            The rows.
        """
        return Buffers(**{field.name: getattr(self, field.name)[begin:end] for field in fields(self)})


class CopyGroup:
    """Copies of an environment, stepped one after the other.

    Args:
        make: A function that makes a copy.
        first: The number of the first copy; it counts in messages and for the seeds.
        num_envs: The number of copies of all groups.
        features: The description of the observation space.
        buffers: The rows of these copies.

    Raises:
        EnvironmentFailure: The first copy can be made and a later one cannot; those made before are closed.
        ValueError: The function returns the same object each time.
    """

    def __init__(
        self,
        make: Callable[[], gymnasium.Env],
        first: int,
        num_envs: int,
        features: Features,
        buffers: Buffers,
    ) -> None:
        self._features, self._buffers, self._num_envs = features, buffers, num_envs
        self._who = [f"environment {first + row}" for row in range(len(buffers.reward))]
        self._seed, self._num_episodes = 0, None
        self._steps = [0] * len(self._who)
        self._write_last = [row_writer(features.space, row) for row in buffers.last]
        self._write_following = [row_writer(features.space, row) for row in buffers.following]
        certain = {group.features for group in Features.of(features.space).groups}
        self._groups = [group for group in features.groups if group.features not in certain]
        """The groups that observations may break; those of a ``Discrete`` are one-hot as they are written."""
        self._last, self._following = list(buffers.last), list(buffers.following)
        self.envs: list[gymnasium.Env] = []
        try:
            for row in range(len(self._who)):
                self.envs.append(_made(make, first + row))
            if len({id(env) for env in self.envs}) < len(self.envs):
                raise ValueError(
                    f"num_envs must be 1, got {num_envs}: the function that makes the environment returns the same "
                    "object each time; let it make a new one"
                )
        except BaseException:
            self.close()
            raise

    def reset(self, seed: int, num_episodes: int | None = None) -> None:
        """Begin the episodes whose numbers stand in the buffers; -1 leaves a copy as it is.

        Args:
            seed: The seed that all episodes' seeds are derived from.
            num_episodes: The number of episodes, of which those with this number and above do not begin.
        """
        self._seed, self._num_episodes = seed, num_episodes
        self._buffers.was_cut.fill(False)
        for row, episode in enumerate(self._buffers.episode.tolist()):
            if episode >= 0:
                self._following[row].fill(0)
                self._begin(row, episode)

    def step(self, max_steps: int | None = None) -> None:
        """Take one step in those copies that are wanted, with the actions in the buffers.

        Args:
            max_steps: The number of steps after which an episode that does not end by itself is truncated.
        """
        buffers, writers = self._buffers, self._write_last
        actions, wanted = (
            buffers.actions.copy(),
            buffers.wanted,
        )  # an environment may keep the action it is given
        rows = range(len(self.envs)) if wanted.all() else np.flatnonzero(wanted).tolist()
        if len(rows) < len(self.envs):
            for array in (buffers.reward, buffers.terminated, buffers.truncated):
                array.fill(0)
        ended = []
        for row in rows:
            action = actions[row]
            observation, reward, terminated, truncated = advance(self.envs[row], action, self._who[row])
            if not writers[row](observation):
                self._last[row][:] = self._flatten(row, observation, f"step({action!r})")
            self._steps[row] = steps = self._steps[row] + 1
            if max_steps is not None and steps >= max_steps and not (terminated or truncated):
                truncated = buffers.was_cut[row] = True
            buffers.reward[row] = reward
            buffers.terminated[row], buffers.truncated[row] = terminated, truncated
            if terminated or truncated:
                ended.append(row)
        if len(rows) == len(self.envs):
            buffers.following[:] = buffers.last
        else:
            buffers.following[rows] = buffers.last[rows]
        if self._groups:
            self._require_one_hot(actions)
        for row in ended:
            buffers.episode[row] += self._num_envs
            self._begin(row, int(buffers.episode[row]))

    def close(self) -> None:
        """Close every copy."""
        while self.envs:
            self.envs.pop().close()

    def _begin(self, row: int, episode: int) -> None:
        if self._num_episodes is not None and episode >= self._num_episodes:
            return
        self._steps[row] = 0
        observation = begin(self.envs[row], self._who[row], seed=nth_episode_seed(self._seed, episode))
        if not self._write_following[row](observation):
            self._following[row][:] = self._flatten(row, observation, "reset()")
        elif self._groups:
            try:
                require_one_hot(self._groups, self._following[row][None])
            except ValueError as error:
                raise failure(self.envs[row], self._who[row], "reset()", error) from error

    def _flatten(self, row: int, observation: Any, where: str) -> Any:
        try:
            flat = self._features.flatten(observation)
            if flat.ndim != 1:
                raise ValueError(f"observation must be a single one, got a batch of shape {flat.shape[:-1]}")
        except Exception as error:
            raise failure(self.envs[row], self._who[row], where, error) from error
        return flat

    def _require_one_hot(self, actions: Shaped[ndarray, "envs ..."]) -> None:
        groups, last = self._groups, self._buffers.last
        wanted = self._buffers.wanted
        try:
            require_one_hot(groups, last[wanted])
        except ValueError:
            for row in np.flatnonzero(wanted).tolist():
                try:
                    require_one_hot(groups, last[row : row + 1])
                except ValueError as error:
                    raise failure(self.envs[row], self._who[row], f"step({actions[row]!r})", error) from error
            raise


def _made(make: Callable[[], gymnasium.Env], index: int) -> gymnasium.Env:
    try:
        return make()
    except Exception as error:
        if index == 0:
            raise
        raise EnvironmentFailure(
            f"num_envs must be at most {index}, as copy {index + 1} of the environment cannot be made "
            f"beside the others: {type(error).__name__}: {error}"
        ) from error
