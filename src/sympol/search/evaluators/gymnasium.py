"""The evaluator of environments that only Gymnasium has: copies stepped in turn, their actions computed together."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Sequence

import gymnasium
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from ...envs.copies import open_copies
from ...envs.spec import EnvSpec
from ...play import SideBySide, episode_seed, limit_of, play_side_by_side
from ...trees import DecisionTree
from .base import Evaluator, Purpose, Returns
from .packed_trees import StackedTrees, leaf_actions


class GymnasiumEvaluator(Evaluator):
    """An evaluator that steps copies of a Gymnasium environment.

    Copies are kept and reset for later episodes, each with that episode's seed; as in training, an environment must
    not remember anything beyond a reset.
    """

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        self._limit = limit_of(spec)
        self._copies: Sequence[gymnasium.Env] | None = None

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        played, shape = self._run(trees, episodes, watch=False), (len(trees), len(episodes))
        return Returns(
            played.returns.reshape(shape).astype(np.float32),
            played.lengths.reshape(shape).astype(np.int32),
        )

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        return self._run([tree], episodes, watch=True).one_by_one()

    def _run(self, trees: Sequence[DecisionTree], episodes: range, *, watch: bool) -> SideBySide:
        packed = StackedTrees.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        actions = leaf_actions(packed, self.spec)

        def act(jobs: ndarray, x: ndarray) -> ndarray:
            tree = jobs // len(episodes)
            return actions[tree, packed.apply(tree, x)]

        seeds = [episode_seed(self.seed, episode, self.purpose) for episode in episodes] * len(trees)
        return play_side_by_side(act, self.spec, self._opened(), seeds, limit=self._limit, watch=watch)

    def _opened(self) -> Sequence[gymnasium.Env]:
        """Return the copies, opened when they are first needed and closed with the evaluator."""
        if self._copies is None:
            stack = contextlib.ExitStack()
            self._copies = stack.enter_context(open_copies(self.spec, self.spec.most_copies))
            weakref.finalize(self, stack.close)
        return self._copies
