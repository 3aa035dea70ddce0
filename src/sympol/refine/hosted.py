"""The arena of an environment that only Gymnasium has: copies stepped one after the other, answered together.

Where an episode is over, its copy begins the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Float32, Int
from numpy import ndarray

from ..envs.env import MAX_EPISODE_STEPS
from ..envs.host import advance, begin
from ..envs.spec import EnvSpec
from ..play import episode_seed
from ..trees import DecisionTree
from .arena import Arena, Played, Purpose
from .packed import Packed, answers

AT_ONCE = 128
"""Episodes that go on side by side, at most."""


class HostArena(Arena):
    """See the module.

    Copies are kept and reset for later episodes, each with that episode's seed; as in training, what an environment
    remembers beyond a reset is its own affair.
    """

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        self._limit = spec.max_episode_steps or MAX_EPISODE_STEPS
        self._at_once = 1 if spec.has_one_copy else AT_ONCE
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
        waiting = iter(range(len(seeds)))
        running: dict[int, gymnasium.Env] = {}
        last: dict[int, Any] = {}
        seen: list[tuple[ndarray, ndarray]] = []
        while True:
            for job in islice(waiting, self._at_once - len(running)):
                running[job] = env = self._copy()
                last[job] = begin(env, seed=seeds[job])
            if not running:
                break
            jobs = np.array([*running])
            x = self.spec.features.flatten_each([last[job] for job in running])
            if watch:
                seen.append((jobs, x))
            tree = jobs // len(episodes)
            for job, action in zip(jobs.tolist(), does[tree, packed.apply(tree, x)], strict=True):
                last[job], reward, terminated, truncated = advance(running[job], action)
                returns[job] += reward
                lengths[job] += 1
                if terminated or truncated or lengths[job] >= self._limit:
                    self._idle.append(running.pop(job))
        shape = len(trees), len(episodes)
        return returns.reshape(shape).astype(np.float32), lengths.reshape(shape), _in_order(seen)

    def _copy(self) -> gymnasium.Env:
        assert self.spec.make_host is not None
        return self._idle.pop() if self._idle else self.spec.make_host()


def _in_order(
    seen: Sequence[tuple[Int[ndarray, " copies"], Float32[ndarray, "copies features"]]],
) -> Float32[ndarray, "steps features"]:
    """What was seen, one episode after the other."""
    if not seen:
        return np.zeros((0, 0), np.float32)
    jobs, rows = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    return rows[np.argsort(jobs, kind="stable")]
