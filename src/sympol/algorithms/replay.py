"""The part of a checkpoint that leads a resumed training back into the episodes that were running on the host.

The state of a Gymnasium environment cannot be saved. But an episode follows from its seed and its actions, so the
number of the episode (from which its seed follows) and the actions since its reset are kept, and a resume replays them.
The last observation is kept, too: where the replay does not lead to it, to the bit, the environment does not follow its
seed.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64, Shaped
from numpy import ndarray

from ..envs.capabilities import VectorEnvs
from ..envs.env import MAX_EPISODE_STEPS

MOST_BYTES = 1 << 26
"""The most memory that the actions of running episodes may take, 64 MiB."""


class EpisodesRestarted(UserWarning):
    """After a resume, training episodes begin anew because their replay led elsewhere."""


class RunningEpisodes(NamedTuple):
    """The running episodes of E copies; all arrays are empty where new episodes are to begin.

    Attributes:
        num_before: How many episodes of each copy came before.
        length: How many steps of each episode have been taken; -1 where the next episode is to begin.
        actions: The last T actions of every copy; those of an episode are the last ``length`` of its column.
        observation: The observation that the next action answers to.
    """

    num_before: Int32[ndarray, " envs"]
    length: Int32[ndarray, " envs"]
    actions: Shaped[ndarray, "steps envs ..."]
    observation: Float32[ndarray, "envs features"]

    @classmethod
    def none(cls, actions: Shaped[ndarray, "envs ..."], num_features: int) -> RunningEpisodes:
        """Return the value that lets new episodes begin; every array may grow along its first axis.

        Args:
            actions: An action of every copy, of which only shape and type matter.
            num_features: The number of features of an observation.

        Returns:
            Empty arrays.
        """
        numbers = np.zeros(0, np.int32)
        return cls(
            numbers,
            numbers,
            np.zeros((0, *actions.shape), actions.dtype),
            np.zeros((0, num_features), np.float32),
        )


def longest_replay(declared: int | None, actions: Shaped[ndarray, "envs ..."]) -> int:
    """Return the number of steps beyond which an episode is not kept, and begins anew after a validation.

    Args:
        declared: The time limit of the environment, if it has one.
        actions: An action of every copy, of which only the size matters.

    Returns:
        The time limit, where there is none or a shorter one `MAX_EPISODE_STEPS`, and in any case so few that the
        actions fit into `MOST_BYTES`.
    """
    return min(max(declared or 0, MAX_EPISODE_STEPS), MOST_BYTES // max(1, actions.nbytes))


class ActionHistory:
    """The actions of the running episodes of E copies, recorded as they are taken.

    Args:
        num_envs: The number of copies, E.
        longest: The number of steps beyond which an episode is not kept.
        length: How many steps each running episode has been running for, and
        actions: the last actions, as in `RunningEpisodes`; by default the episodes have just begun.
    """

    def __init__(
        self,
        num_envs: int,
        longest: int,
        length: Int32[ndarray, " envs"] | None = None,
        actions: Shaped[ndarray, "steps envs ..."] | None = None,
    ) -> None:
        self._longest = longest
        self._length = np.zeros(num_envs, np.int32) if length is None else length.astype(np.int32)
        self._blocks: list[ndarray] = [] if actions is None or not len(actions) else [actions]
        self._steps: list[ndarray] = []

    def append(self, actions: Shaped[ndarray, "envs ..."], done: Bool[ndarray, " envs"]) -> None:
        """Record one step of every copy.

        Args:
            actions: The actions, as the environments took them.
            done: Whether an episode ended with it.
        """
        self._steps.append(actions)
        self._length += 1
        self._length[done] = 0

    def end_rollout(self) -> None:
        """Forget the actions that no running episode needs any more."""
        if self._steps:
            self._blocks = [*self._blocks, np.stack(self._steps)]
            self._steps = []
        needed = self._needed()
        while self._blocks and sum(map(len, self._blocks[1:])) >= needed:
            self._blocks = self._blocks[1:]  # a new list, as others may hold the old one

    def _needed(self) -> int:
        return int(self._length[self._length <= self._longest].max(initial=0))

    def freeze(
        self, episode: Int64[ndarray, " envs"], observation: Float32[ndarray, "envs features"]
    ) -> FrozenHistory:
        """Return what is known after a rollout; what is recorded later does not change it.

        Args:
            episode: The number of the episode that each copy plays.
            observation: The observation that the next action answers to.

        Returns:
            The record, from which `RunningEpisodes` can be made.
        """
        return FrozenHistory(
            self._blocks, self._needed(), self._length.copy(), self._longest, episode, observation
        )


class FrozenHistory(NamedTuple):
    """The record of an `ActionHistory` at the end of a rollout."""

    blocks: list[ndarray]
    needed: int
    length: Int32[ndarray, " envs"]
    longest: int
    episode: Int64[ndarray, " envs"]
    observation: Float32[ndarray, "envs features"]

    def running(self, none: RunningEpisodes) -> RunningEpisodes:
        """Return the record as arrays to save.

        Args:
            none: The value for no episodes at all.

        Returns:
            The arrays.
        """
        actions = np.concatenate(self.blocks) if self.needed else none.actions
        return RunningEpisodes(
            num_before=(self.episode // len(self.episode)).astype(np.int32),
            length=np.where(self.length > self.longest, -1, self.length).astype(np.int32),
            actions=actions[len(actions) - self.needed :],
            observation=self.observation,
        )


def first_episodes(num_envs: int, num_before: Any) -> Int64[ndarray, " envs"]:
    """Return the number of each copy's episode when some of each came before; see `VectorEnvs`."""
    return np.arange(num_envs, dtype=np.int64) + num_envs * np.asarray(num_before, np.int64)


def replay(
    envs: VectorEnvs, seed: int, running: RunningEpisodes
) -> tuple[Float32[ndarray, "envs features"], Bool[ndarray, " envs"]]:
    """Bring copies to where they were.

    Args:
        envs: The copies, of which any episodes are given up.
        seed: The seed that all episodes' seeds are derived from.
        running: Where they were.

    Returns:
        The observations that the next actions answer to, and which episodes begin anew.
    """
    num_envs, steps = envs.num_envs, len(running.actions)
    restarted = np.asarray(running.length) < 0
    episode = first_episodes(num_envs, running.num_before + restarted)
    observation = envs.reset(seed, episodes=episode)
    went_astray = np.zeros(num_envs, bool)
    for time in range(steps):
        wanted = (steps - time <= running.length) & ~went_astray
        step, following = envs.step(running.actions[time], wanted)
        observation = np.where(wanted[:, None], following, observation)
        went_astray |= wanted & np.asarray(step.terminated | step.truncated)
    went_astray |= ~restarted & (observation != running.observation).any(axis=1)
    if went_astray.any():
        warnings.warn(
            f"{went_astray.sum()} of {num_envs} training episodes begin anew: the environment did not repeat them when "
            "their seed and actions were replayed, so this training differs from one without an interruption; "
            "environments whose chance follows reset(seed=...) alone resume exactly",
            EpisodesRestarted,
            stacklevel=2,
        )
        again = envs.reset(seed, episodes=np.where(went_astray, episode + num_envs, -1))
        observation = np.where(went_astray[:, None], again, observation)
    return observation, restarted | went_astray
