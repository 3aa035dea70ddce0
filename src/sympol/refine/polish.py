"""Better numbers for a tree that asks the right questions: its thresholds, all at once, by an evolution strategy.

CMA-ES (Hansen and Ostermeier 2001; the implementation is pycma's) draws trees around the present one, lets them play,
and moves towards those that earned more, along directions that it learns. In a generation all play the same episodes,
in the next one others, so that what is climbed is the mean return and not the luck of some episodes. Which features are
asked about, and what discrete leaves answer, stays as it is. The answers of continuous actions are numbers, too.

Distances are counted in the spread of what the tree sees: a step of 1 is one standard deviation of the feature, or half
the range of an action.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Float32, Int

from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.floats import flushed
from .arena import Arena
from .evolve import Budget

STEP = 0.1
"""How far the first trees lie from the one that is given."""
WATCHED = 16
"""Episodes that are observed, to know how widely features spread."""
TOLD = 10
"""Generations between two reports."""
FLAT = 10
"""Generations in which all trees earn the same, after which nothing is left to gain."""
JUDGED = 4
"""Times the episodes of a generation, to say at the end whether anything was gained."""


class Polished(NamedTuple):
    """What ``progress`` is told now and then."""

    tree: DecisionTree
    """The middle of what is drawn."""
    steps: int
    """Environment steps so far."""
    seconds: float
    mean: float
    """Return of the last generation."""


Progress: TypeAlias = Callable[[Polished], object]


def polish(
    tree: DecisionTree,
    arena: Arena,
    *,
    budget: Budget,
    episodes: int = 32,
    first_episode: int = 0,
    seed: int = 0,
    progress: Progress | None = None,
) -> DecisionTree:
    """The tree with better numbers; as it was given if that earns more in episodes that nothing was searched on.

    Args:
        tree: of any size; it keeps it, but prune it afterwards, as some of its splits may be idle then.
        arena: where it plays.
        budget: how long to search: it ends with the generation that spends it, or where nothing is left to gain.
        episodes: of a generation, the same ones for all of its trees.
        first_episode: episodes from this number on are played.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.
        progress: called every few generations.

    Raises:
        ImportError: pycma is not installed.
        ValueError: a tree for other features or actions, or no episodes.
    """
    began, before = time.perf_counter(), arena.steps
    numbers = Numbers.of(tree, arena.observe(tree, range(first_episode, first_episode + WATCHED)))
    if not numbers.size:
        return tree
    search = _strategy(numbers.size, seed)
    next_episode, generation = first_episode + WATCHED, 0

    def goes_on() -> bool:
        spent = arena.steps - before, time.perf_counter() - began
        return spent[0] < budget.steps and spent[1] < budget.seconds and not search.stop()

    while goes_on():
        drawn = search.ask()
        trees = [numbers.moved(step) for step in drawn]
        returns = arena.play(trees, range(next_episode, next_episode + episodes)).returns
        means = returns.mean(axis=1, dtype=np.float64)
        search.tell(drawn, (-means).tolist())
        next_episode += episodes
        generation += 1
        if progress is not None and generation % TOLD == 0:
            middle = numbers.moved(search.result.xfavorite)
            seconds = time.perf_counter() - began
            progress(Polished(middle, arena.steps - before, seconds, float(means.mean())))
    if not generation:
        return tree
    middle = numbers.moved(search.result.xfavorite)
    judged = range(next_episode, next_episode + JUDGED * episodes)
    given, found = arena.play([tree, middle], judged).returns.mean(axis=1, dtype=np.float64)
    return middle if found > given else tree


@dataclass(frozen=True)
class Numbers:
    """The numbers of a tree that may move, and how far a step of 1 moves each of them."""

    tree: DecisionTree
    splits: Int[np.ndarray, " thresholds"]
    """Nodes that ask about a number; categories have no threshold worth moving."""
    leaves: Int[np.ndarray, " leaves"]
    """Nodes whose answers are numbers."""
    scale: Float[np.ndarray, " size"]

    @staticmethod
    def of(tree: DecisionTree, seen: Float32[np.ndarray, "steps features"]) -> Numbers:
        """Those of a tree that sees these observations; a feature that never differs there does not move."""
        splits = np.array(
            [n for n in np.flatnonzero(~tree.is_leaf) if tree.feature[n] not in tree.group_of], int
        )
        spread = seen.std(axis=0, dtype=np.float64)
        splits = splits[spread[tree.feature[splits]] > 0]
        leaves, reach = np.zeros(0, int), np.zeros(0)
        if isinstance(tree.actions, BoxActions):
            leaves = np.flatnonzero(tree.is_leaf)
            low, high = (
                np.asarray(tree.actions.low, float).ravel(),
                np.asarray(tree.actions.high, float).ravel(),
            )
            bounded = np.isfinite(low) & np.isfinite(high)
            reach = np.where(bounded, (high - low) / 2, 1.0)
        scale = np.concatenate([spread[tree.feature[splits]], np.tile(reach, len(leaves))])
        return Numbers(tree, splits, leaves, scale)

    @property
    def size(self) -> int:
        """How many there are."""
        return len(self.scale)

    def moved(self, steps: Float[np.ndarray, " size"]) -> DecisionTree:
        """The tree with each number moved so many steps."""
        way = np.asarray(steps) * self.scale
        threshold, value = self.tree.threshold.copy(), self.tree.value.copy()
        n = len(self.splits)
        threshold[self.splits] = flushed(np.float32(threshold[self.splits] + way[:n]))
        if len(self.leaves):
            value[self.leaves] = np.float32(value[self.leaves] + way[n:].reshape(len(self.leaves), -1))
        return replace(self.tree, threshold=threshold, value=value, n_node_samples=None)


def _strategy(size: int, seed: int) -> Any:
    """CMA-ES as pycma has it, with a random generator of its own in place of NumPy's global one."""
    try:
        from cma import CMAEvolutionStrategy
    except ImportError as error:
        raise ImportError(
            "polishing a tree needs pycma, which is not installed; install it: pip install 'sympol[bench]'"
        ) from error
    rng = np.random.default_rng(seed)
    options = {
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # do not seed NumPy
        # returns are noisy: neither that the best was long ago nor that it is always the same means much
        "tolstagnation": math.inf,
        "tolfun": 0,
        "tolfunhist": 0,
        "tolflatfitness": FLAT,
        "verbose": -10,  # no words, and no file of signals is read
    }
    return CMAEvolutionStrategy(np.zeros(size), STEP, options)
