"""What trees earn in the first so many of a row of episodes; what was played once is not played again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from ..trees import DecisionTree
from .evaluators.base import Arena


class Scores:
    """Returns by tree, of the episodes from ``first_episode`` on."""

    def __init__(self, arena: Arena, first_episode: int = 0) -> None:
        self.arena, self.first_episode = arena, first_episode
        self._known: dict[DecisionTree, Float32[np.ndarray, " episodes"]] = {}

    def of(self, tree: DecisionTree, number: int) -> Float32[np.ndarray, " episodes"]:
        """Of one tree, in the first ``number`` episodes."""
        return self.of_all([tree], number)[0]

    def of_all(
        self, trees: Sequence[DecisionTree], number: int, *, like: DecisionTree | None = None
    ) -> Float32[np.ndarray, "trees episodes"]:
        """Of many trees, in the first ``number`` episodes; they play together those that they have not played.

        ``like`` is a tree that most of them mostly do as, if there is one: see `Arena.play_changed`.
        """
        by_played: dict[int, dict[DecisionTree, None]] = {}
        for tree in trees:
            played = len(self._known.get(tree, ()))
            if played < number:
                by_played.setdefault(played, {})[tree] = None
        for played, some in by_played.items():
            more = range(self.first_episode + played, self.first_episode + number)
            playing = [tree for tree in some if tree != like]
            if like is None:
                returns = self.arena.play(playing, more).returns
            else:
                returns = self.arena.play_changed(like, playing, more).returns
                playing.insert(0, like)
            for tree, new in zip(playing, returns, strict=True):
                if tree in some:
                    known = self._known[tree] if played else new[:0]
                    self._known[tree] = np.concatenate([known, new])
        return np.stack([self._known[tree][:number] for tree in trees])
