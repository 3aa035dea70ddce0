"""Where trees are compared: many of them on the same episodes.

An episode has a number. Whatever is random in it, its start and its noise, depends on that number, the arena's seed
and its purpose alone, so that two trees in the same episode differ by what they do (common random numbers).
"""

from __future__ import annotations

import abc
from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32, Int32

from ..envs.spec import EnvSpec
from ..trees import DecisionTree

Purpose: TypeAlias = Literal["refine", "validation"]
"""Episodes to search with, and others to choose with; neither are ever test episodes."""


class Played(NamedTuple):
    """What each tree brought home from each episode."""

    returns: Float32[np.ndarray, "trees episodes"]
    """Undiscounted."""
    lengths: Int32[np.ndarray, "trees episodes"]
    """Steps."""


class Arena(abc.ABC):
    """Plays trees on numbered episodes of one environment, deterministically, and counts what that costs."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        self.spec, self.seed = spec, seed
        self.purpose: Purpose = purpose
        self.steps = 0
        """Environment steps so far, those of `observe` among them."""

    def play(self, trees: Sequence[DecisionTree], episodes: range) -> Played:
        """Each tree on each of the episodes.

        Raises:
            ValueError: no trees, no episodes, or a tree for other features or actions.
        """
        if not trees or not episodes:
            raise ValueError(
                f"an arena needs trees and episodes, got {len(trees)} trees and {len(episodes)} episodes"
            )
        for tree in trees:
            if tree.n_features != len(self.spec.features.names) or tree.actions.n_outputs != self.outputs:
                raise ValueError(
                    f"a tree of {tree.n_features} features and {tree.actions.n_outputs} outputs cannot play "
                    f"{self.spec.name}, which has {len(self.spec.features.names)} and {self.outputs}"
                )
        played = self._play(trees, episodes)
        self.steps += int(played.lengths.sum(dtype=np.int64))
        return played

    def observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]:
        """The observations that a tree acts on in these episodes, one row a step."""
        seen = self._observe(tree, episodes)
        self.steps += len(seen)
        return seen

    @property
    def outputs(self) -> int:
        """Numbers in a leaf."""
        return self.spec.actions.n_outputs

    @abc.abstractmethod
    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Played: ...

    @abc.abstractmethod
    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]: ...


def make_arena(spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> Arena:
    """An arena inside a compiled program where the environment is written in JAX, on the host otherwise."""
    if spec.env is not None:
        from .compiled import CompiledArena

        return CompiledArena(spec, seed, purpose)
    from .hosted import HostArena

    return HostArena(spec, seed, purpose)
