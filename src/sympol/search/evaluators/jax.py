"""The arena of an environment written in JAX: one compiled program with a queue of episodes.

Lanes step side by side. Where episodes have ended, lanes take the next ones from the queue, some at a time, so that
short episodes wait for no long ones. Numbers of trees, of episodes and of nodes are traced: one program plays all trees
of up to 32 leaves, another those of up to 127 nodes, 255, ….
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from ...compilation import require_no_fork
from ...envs.env import Env
from ...envs.spec import EnvSpec
from ...play import WORDS
from ...trees import DecisionTree
from .base import Arena, Played, Purpose
from .batched_rollouts import MAX_JOBS, WATCHED, Forest, player, watcher
from .bitmask_trees import MAX_LEAVES, Masked
from .pointer_trees import Linked
from .stacked_trees import Packed

MAX_TREES = 1 << 8
"""Trees in one call."""


class CompiledArena(Arena):
    """See the module."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert spec.env is not None
        self._env: Env = spec.env
        self._key = np.array([WORDS[purpose], seed], np.uint32)

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Played:
        require_no_fork()
        run, at_once = player(self._env), min(len(episodes), MAX_JOBS)
        rows = min(MAX_TREES, MAX_JOBS // at_once)
        played: list[list[ndarray]] = []
        for i in range(0, len(trees), rows):
            some = trees[i : i + rows]
            forest, parts = _forest(some, MAX_TREES), []
            for j in range(0, len(episodes), at_once):
                numbers = episodes[j : j + at_once]
                results = run(forest, self._key, *map(np.int32, (numbers.start, len(numbers), len(some))))
                shape = (len(some), len(numbers))
                parts.append([np.asarray(part)[: shape[0] * shape[1]].reshape(shape) for part in results])
            played.append([np.concatenate(part, axis=1) for part in zip(*parts, strict=True)])
        return Played(*(np.concatenate(part) for part in zip(*played, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        require_no_fork()
        watch, forest = watcher(self._env), _forest([tree], 1)
        seen = []
        for i in range(0, len(episodes), WATCHED):
            numbers = episodes[i : i + WATCHED]
            rows, running = map(np.asarray, watch(forest, self._key, np.int32(numbers.start)))
            seen += [rows[running[:, k], k] for k in range(len(numbers))]
        return np.concatenate(seen)


def _forest(trees: Sequence[DecisionTree], num_trees: int) -> Forest:
    if max(tree.n_leaves for tree in trees) <= MAX_LEAVES:
        return Masked.of(trees, num_trees)
    num_nodes = (1 << max(tree.n_nodes for tree in trees).bit_length()) - 1
    return Linked.of(Packed.of(trees, num_trees, num_nodes))
