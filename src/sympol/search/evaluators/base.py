"""The base class of evaluators, which compare many trees on the same episodes.

An episode has a number. Its start and its noise depend only on that number, the evaluator's seed and its purpose, so
that two trees in the same episode differ only by their actions (common random numbers).
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from jaxtyping import Float32, Int32

from ...envs.errors import EnvironmentFailure
from ...envs.spec import EnvSpec
from ...trees import ActionSpec, BoxActions, DecisionTree, DiscreteActions

Purpose: TypeAlias = Literal["refine", "validation"]
"""Episodes to search with, and others to validate with; neither are test episodes."""
_MAX_EPISODES = 1 << 31


class Returns(NamedTuple):
    """The return and the length of each episode, by tree."""

    returns: Float32[np.ndarray, "trees episodes"]
    """The undiscounted returns."""
    lengths: Int32[np.ndarray, "trees episodes"]
    """The numbers of steps."""


class Evaluator(abc.ABC):
    """A player of trees on numbered episodes of one environment, which counts their steps.

    Args:
        spec: The environment.
        seed: The seed of the episodes, between 0 and 2^32 - 1.
        purpose: Episodes to search with, or others to validate with.

    Raises:
        ValueError: A seed out of range, or an unknown purpose.
    """

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        if not 0 <= seed < 1 << 32:
            raise ValueError(f"an evaluator's seed must be between 0 and 2^32 - 1, got {seed}")
        if purpose not in get_args(Purpose):
            raise ValueError(
                f"an evaluator's purpose must be one of {', '.join(get_args(Purpose))}, got {purpose!r}"
            )
        self.spec, self.seed = spec, seed
        self.purpose: Purpose = purpose
        self.steps = 0
        """Environment steps so far, including those of `observe`."""

    def play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        """Play each tree on each of the episodes.

        Args:
            trees: The trees, at least one.
            episodes: Consecutive episode numbers.

        Returns:
            Their returns and lengths ``[trees, episodes]``.

        Raises:
            ValueError: No trees, no episodes, or a tree for other features or actions.
            EnvironmentFailure: A return that is not finite.
        """
        self._check(trees, episodes)
        played = self._play(trees, episodes)
        return self._checked(played, episodes, int(played.lengths.sum(dtype=np.int64)))

    def play_variants(self, tree: DecisionTree, others: Sequence[DecisionTree], episodes: range) -> Returns:
        """Play a tree and variants of it.

        Where an evaluator can, steps that variants share with the tree are played once, and count once.

        Args:
            tree: The tree.
            others: Its variants.
            episodes: Consecutive episode numbers.

        Returns:
            The same as of `play`, first of the tree and then of the variants.

        Raises:
            ValueError, EnvironmentFailure: As `play` does.
        """
        self._check([tree, *others], episodes)
        played, steps = self._play_variants([tree, *others], episodes)
        return self._checked(played, episodes, steps)

    def observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]:
        """Return the observations that a tree acts on.

        Args:
            tree: The tree.
            episodes: Consecutive episode numbers.

        Returns:
            The observations ``[steps, features]``, episode by episode.

        Raises:
            ValueError: As `play` does.
        """
        self._check([tree], episodes)
        seen = self._observe(tree, episodes)
        self.steps += len(seen)
        return seen

    def _checked(self, played: Returns, episodes: range, steps: int) -> Returns:
        self.steps += steps
        if not np.isfinite(played.returns).all():
            tree, episode = np.argwhere(~np.isfinite(played.returns))[0]
            raise EnvironmentFailure(
                f"{self.spec.name} returned rewards whose sum is not finite in float32: tree {tree} in episode "
                f"{episodes[episode]} got {played.returns[tree, episode]}"
            )
        return played

    def _check(self, trees: Sequence[DecisionTree], episodes: range) -> None:
        if not trees or not episodes:
            raise ValueError(
                f"an evaluator needs trees and episodes, got {len(trees)} trees and {len(episodes)} episodes"
            )
        if episodes.step != 1 or not 0 <= episodes.start < episodes.stop <= _MAX_EPISODES:
            raise ValueError(
                f"episodes must be consecutive numbers between 0 and {_MAX_EPISODES - 1}, got {episodes}"
            )
        for tree in trees:
            if tree.n_features != len(self.spec.features.names):
                raise ValueError(
                    f"a tree of {tree.n_features} features cannot play {self.spec.name}, which has "
                    f"{len(self.spec.features.names)}"
                )
            if tree.actions is not self.spec.actions and _plain(tree.actions) != _plain(self.spec.actions):
                raise ValueError(
                    f"a tree that acts by {tree.actions} cannot play {self.spec.name}: {self.spec.actions}"
                )

    @abc.abstractmethod
    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns: ...

    def _play_variants(self, trees: Sequence[DecisionTree], episodes: range) -> tuple[Returns, int]:
        """Play variants of the first tree; return the number of steps, too."""
        played = self._play(trees, episodes)
        return played, int(played.lengths.sum(dtype=np.int64))

    @abc.abstractmethod
    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]: ...


def _plain(actions: ActionSpec) -> tuple[object, ...]:
    """Return what must agree between actions: neither their names nor their noise."""
    if isinstance(actions, BoxActions):
        return actions.low, actions.high, actions.shape
    return actions.n if isinstance(actions, DiscreteActions) else actions.nvec, actions.start
