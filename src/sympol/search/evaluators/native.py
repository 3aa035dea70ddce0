"""The evaluator of environments with machine code, which plays whole episodes in one thread per processor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from ...envs.capabilities import NativeEngine
from ...envs.spec import EnvSpec
from ...play import episode_seed
from ...threads import threads
from ...trees import DecisionTree
from .base import Evaluator, Purpose, Returns
from .packed_trees import StackedTrees, leaf_actions

T = TypeVar("T")


class NativeEvaluator(Evaluator):
    """An evaluator that plays episodes by an environment's native engine."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert spec.native is not None
        self._engine: NativeEngine = spec.native

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        packed = StackedTrees.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        actions = leaf_actions(packed, self.spec)
        seeds = np.tile(self._seeds(episodes), len(trees))
        tree = np.repeat(np.arange(len(trees), dtype=np.int32), len(episodes))
        played = _shared(lambda part: self._engine.play(packed, actions, tree[part], seeds[part]))
        returns, lengths = np.zeros(len(seeds), np.float32), np.zeros(len(seeds), np.int32)
        for part, (earned, took) in played:
            returns[part], lengths[part] = earned, took
        shape = len(trees), len(episodes)
        return Returns(returns.reshape(shape), lengths.reshape(shape))

    def _play_variants(self, trees: Sequence[DecisionTree], episodes: range) -> tuple[Returns, int]:
        packed = StackedTrees.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        actions, seeds = leaf_actions(packed, self.spec), self._seeds(episodes)
        parts = _shared(lambda part: self._engine.play_similar(packed, actions, seeds[part]))
        shape = len(trees), len(seeds)
        played = Returns(np.zeros(shape, np.float32), np.zeros(shape, np.int32))
        for part, (earned, took, _) in parts:
            played.returns[:, part], played.lengths[:, part] = earned, took
        return played, sum(steps for _, (*_, steps) in parts)

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        packed = StackedTrees.of([tree], 1, tree.n_nodes)
        return self._engine.observe(packed, leaf_actions(packed, self.spec), self._seeds(episodes))

    def _seeds(self, episodes: range) -> ndarray:
        return np.array([episode_seed(self.seed, episode, self.purpose) for episode in episodes], np.uint64)


def _shared(play_part: Callable[[slice], T]) -> list[tuple[slice, T]]:
    """Play a part of the episodes in each thread, some of every tree's; return the parts with their results."""
    number = threads()
    parts = [slice(i, None, number) for i in range(number)]
    with ThreadPoolExecutor(number) as pool:
        return list(zip(parts, pool.map(play_part, parts), strict=True))
