"""The arena of an environment that only the host steps: envpool's copies where there are any, else Gymnasium's.

Episodes run in crowds, one copy of the environment each. A copy whose episode has ended is not stepped any more, and
the next crowd begins when few are left, so that one long episode holds nobody up. While envpool's threads step one
crowd, the trees answer another.
"""

from __future__ import annotations

import abc
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import gymnasium
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int
from numpy import ndarray

from ..envs.env import MAX_EPISODE_STEPS
from ..envs.pool import make_pool
from ..envs.spec import EnvSpec
from ..play import episode_seed
from ..trees import DecisionTree
from ..trees.floats import flushed
from .arena import Arena, Played, Purpose
from .packed import Packed, answers

CROWD = 128
"""Episodes that begin together, and when fewer than that are going on, the next ones do.

Larger pools of envpool's step slower, smaller ones are more often left with few copies.
"""


class Moved(NamedTuple):
    """What a step of a crowd led to."""

    observation: Float32[ndarray, "copies features"]
    reward: Float64[ndarray, " copies"]
    over: Bool[ndarray, " copies"]


class Crowd(abc.ABC):
    """Some episodes going on side by side; those that are over leave it."""

    def __init__(self, jobs: Int[ndarray, " copies"]) -> None:
        self.jobs = jobs
        """Which episodes of the call they are."""
        self.copies = np.arange(len(jobs))
        """Their copies of the environment."""

    def keep(self, kept: Bool[ndarray, " copies"]) -> None:
        """The others leave."""
        self.jobs, self.copies = self.jobs[kept], self.copies[kept]

    @abc.abstractmethod
    def begin(self) -> Float32[ndarray, "copies features"]:
        """The first observations."""

    @abc.abstractmethod
    def send(self, actions: ndarray) -> None:
        """Let each copy that is left take its action."""

    @abc.abstractmethod
    def receive(self) -> Moved:
        """What came of it."""


class PoolCrowd(Crowd):
    """A pool of envpool's, which is seeded when it is made."""

    def __init__(self, jobs: Int[ndarray, " copies"], task: str, seeds: Sequence[int]) -> None:
        super().__init__(jobs)
        # envpool takes int32; they stay even, as everywhere but in tests
        self._pool = make_pool(task, [seed >> 2 << 1 for seed in seeds])

    def begin(self) -> Float32[ndarray, "copies features"]:
        """The first observations."""
        return flushed(self._pool.reset()[0])

    def send(self, actions: ndarray) -> None:
        """Let its threads begin."""
        narrow = np.float32 if actions.dtype.kind == "f" else np.int32
        self._pool.send(actions.astype(narrow), self.copies)

    def receive(self) -> Moved:
        """Wait for them."""
        observation, reward, terminated, truncated, _ = self._pool.recv()
        return Moved(flushed(observation), reward.astype(np.float64), terminated | truncated)


class GymnasiumCrowd(Crowd):
    """Gymnasium's environments, stepped one after the other, out of a stock of idle ones."""

    def __init__(
        self, jobs: Int[ndarray, " copies"], spec: EnvSpec, idle: list[gymnasium.Env], seeds: Sequence[int]
    ) -> None:
        super().__init__(jobs)
        assert spec.make_host is not None
        self._features, self._idle, self._seeds = spec.features, idle, seeds
        self._envs = [idle.pop() if idle else spec.make_host() for _ in jobs]

    def keep(self, kept: Bool[ndarray, " copies"]) -> None:
        """The others leave; their copies are idle."""
        self._idle += [self._envs[copy] for copy in self.copies[~kept]]
        super().keep(kept)

    def begin(self) -> Float32[ndarray, "copies features"]:
        """The first observations."""
        return self._features.flatten_each(
            [env.reset(seed=seed)[0] for env, seed in zip(self._envs, self._seeds, strict=True)]
        )

    def send(self, actions: ndarray) -> None:
        """Keep them until somebody waits for what comes of it."""
        self._actions = actions

    def receive(self) -> Moved:
        """Step."""
        pairs = zip(self.copies.tolist(), self._actions, strict=True)
        observation, reward, terminated, truncated, _ = zip(
            *(self._envs[copy].step(action) for copy, action in pairs), strict=True
        )
        return Moved(
            self._features.flatten_each(observation),
            np.array(reward, np.float64),
            np.array(terminated, bool) | np.array(truncated, bool),
        )


class HostArena(Arena):
    """See the module.

    Gymnasium's copies are kept and reset for later episodes, each with that episode's seed; as in training, what an
    environment remembers beyond a reset is its own affair.
    """

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        self._limit = spec.max_episode_steps or MAX_EPISODE_STEPS
        self._at_once = 1 if spec.has_one_copy else CROWD
        self._idle: list[gymnasium.Env] = []

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Played:
        returns, lengths, _ = self._run(trees, episodes, watch=False)
        return Played(returns, lengths)

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        return self._run([tree], episodes, watch=True)[2]

    def _run(self, trees: Sequence[DecisionTree], episodes: range, *, watch: bool) -> tuple[ndarray, ...]:
        packed = Packed.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        does = answers(packed, self.spec)
        seeds = [episode_seed(self.seed, episode, self.purpose) for episode in episodes] * len(trees)
        returns, lengths = np.zeros(len(seeds)), np.zeros(len(seeds), np.int32)
        crowds: deque[Crowd] = deque()
        seen: list[tuple[ndarray, ndarray]] = []

        def act(crowd: Crowd, x: Float32[ndarray, "copies features"]) -> None:
            if watch:
                seen.append((crowd.jobs, x))
            tree = crowd.jobs // len(episodes)
            crowd.send(does[tree, packed.apply(tree, x)])
            crowds.append(crowd)

        begun = 0
        while crowds or begun < len(seeds):
            if begun < len(seeds) and sum(len(crowd.jobs) for crowd in crowds) < self._at_once:
                jobs = np.arange(begun, min(begun + self._at_once, len(seeds)))
                crowd = self._crowd(jobs, seeds[begun : begun + len(jobs)])
                begun += len(jobs)
                act(crowd, crowd.begin())
                continue
            crowd = crowds.popleft()
            moved = crowd.receive()
            returns[crowd.jobs] += moved.reward
            lengths[crowd.jobs] += 1
            going_on = ~moved.over & (lengths[crowd.jobs] < self._limit)
            crowd.keep(going_on)
            if going_on.any():
                act(crowd, moved.observation[going_on])

        shape = len(trees), len(episodes)
        return returns.reshape(shape).astype(np.float32), lengths.reshape(shape), _in_order(seen)

    def _crowd(self, jobs: Int[ndarray, " copies"], seeds: Sequence[int]) -> Crowd:
        if self.spec.pool_task is not None:
            return PoolCrowd(jobs, self.spec.pool_task, seeds)
        return GymnasiumCrowd(jobs, self.spec, self._idle, seeds)


def _in_order(
    seen: Sequence[tuple[Int[ndarray, " copies"], Float32[ndarray, "copies features"]]],
) -> Float32[ndarray, "steps features"]:
    """What was seen, one episode after the other."""
    if not seen:
        return np.zeros((0, 0), np.float32)
    jobs, rows = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    return rows[np.argsort(jobs, kind="stable")]
