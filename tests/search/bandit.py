"""An evaluator whose returns anybody can work out: an episode is a few observations, its return how many get the answer
that a teacher gives (or, of continuous actions, how far off all answers are)."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from sympol.search.evaluators.base import Evaluator, Returns
from sympol.trees import BoxActions, DecisionTree

LENGTH = 20


class Bandit(Evaluator):
    """Observations are normal, each feature apart from the others; where ``whole``, rounded to tenths."""

    def __init__(
        self, teacher: DecisionTree, seed: int = 0, *, hosted: bool = False, whole: bool = False
    ) -> None:
        spec: Any = SimpleNamespace(
            name="bandit",
            backend="host" if hosted else "jax",
            features=SimpleNamespace(names=teacher.feature_names),
            actions=teacher.actions,
        )
        super().__init__(spec, seed)
        self.teacher, self.whole = teacher, whole
        self.calls: list[tuple[int, range]] = []
        self._seen: dict[int, np.ndarray] = {}

    def seen_in(self, episodes: range) -> np.ndarray:
        for episode in set(episodes) - set(self._seen):
            x = np.random.default_rng([self.seed, episode]).normal(size=(LENGTH, self.teacher.n_features))
            self._seen[episode] = (x.round(1) if self.whole else x).astype(np.float32)
        return np.concatenate([self._seen[episode] for episode in episodes])

    def returns_of(self, tree: DecisionTree, episodes: range) -> np.ndarray:
        x = self.seen_in(episodes)
        given, wanted = (each.predict(x).reshape(len(x), -1) for each in (tree, self.teacher))
        if isinstance(tree.actions, BoxActions):
            rewards = -np.square(given - wanted).sum(axis=1)
        else:
            rewards = (given == wanted).all(axis=1)
        return rewards.reshape(-1, LENGTH).sum(axis=1).astype(np.float32)

    def _play(self, trees: Any, episodes: range) -> Returns:
        self.calls.append((len(trees), episodes))
        returns = np.stack([self.returns_of(tree, episodes) for tree in trees])
        return Returns(returns, np.full(returns.shape, LENGTH, np.int32))

    def _observe(self, tree: DecisionTree, episodes: range) -> np.ndarray:
        return self.seen_in(episodes)
