"""Better numbers for a tree that asks the right questions: its thresholds, all at once, by an evolution strategy.

CMA-ES (Hansen and Ostermeier 2001; the implementation is pycma's) draws trees around the present one, lets them play,
and moves towards those that earned more, along directions that it learns. In a generation all play the same episodes,
in the next one others, so that what is climbed is the mean return and not the luck of some episodes. Which features are
asked about, and what discrete leaves answer, stays as it is. The answers of continuous actions are numbers, too.

The higher it has climbed, the less its trees differ in what they earn, and the more episodes it takes to see which are
better. So one half of the episodes is asked whether it ranks the trees as the other does. Where the halves hardly
agree, later generations play twice as many; where they agree well, half as many.

Distances are counted in the spread of what the tree sees: a step of 1 is one standard deviation of the feature, or half
the range of an action.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Float32, Int

from ..seeds import SeedStream
from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.floats import flushed
from .budget import Budget
from .evaluators.base import Evaluator

POPULATION_FACTOR = 2
"""Sampled trees, as a multiple of the default of CMA-ES: the mean of many trees, each judged by chance, errs less.
 On LunarLander better than twice the episodes, or than four times the trees."""
INITIAL_STEP = 0.1
"""How far the first trees lie from the one that is given."""
OBSERVED = 16
"""Episodes that are observed, to know how widely features spread."""
REPORT_EVERY = 4
"""Generations between two reports."""
SCHEDULE_WINDOW = 8
"""Generations by which the number of episodes is decided."""
AGREEMENT_BOUNDS = (0.25, 0.6)
"""Correlation of what trees earn in the two halves of the episodes: below the first there are more, above the second
fewer."""
MAX_EPISODE_FACTOR = 4
"""Times as many episodes as at first, and no more."""
HALVINGS = 4
"""Parts of a budget, after each of which the better half of the trees continues."""
MEAN_WINDOW = 5
"""Generations by which that is decided."""
FLAT_GENERATIONS = 10
"""Generations in which all trees earn the same, after which nothing is left to gain."""
JUDGING_FACTOR = 4
"""Times the episodes of a generation, to say at the end whether anything was gained."""


class FinetuneProgress(NamedTuple):
    """The state of fine-tuning, which ``progress`` receives every few generations."""

    tree: DecisionTree
    """The best so far: the mean of the search distribution."""
    steps: int
    """Environment steps so far."""
    seconds: float
    mean: float
    """Return of the last few generations."""


Progress: TypeAlias = Callable[[FinetuneProgress], object]
GenerationReturns: TypeAlias = Float[np.ndarray, "trees episodes"]


def finetune_thresholds(
    trees: Sequence[DecisionTree],
    evaluator: Evaluator,
    *,
    budget: Budget,
    episodes: int = 32,
    first_episode: int = 0,
    seed: int = 0,
    progress: Progress | None = None,
) -> DecisionTree:
    """The best of some trees with better numbers; as it was given if that earns more in episodes of their own.

    How good a tree can become depends on the features it tests. So several start side by side; after a quarter of
    the budget the better half of them continues, after the next quarter half of these, and so on.

    Args:
        trees: of any sizes. The best keeps its size, but prune it afterwards: some of its splits may be idle then.
        evaluator: where they play.
        budget: how long to search: it ends with the generation that spends it, or where nothing is left to gain.
        episodes: of the first generations, the same ones for all trees of a generation.
        first_episode: episodes from this number on are played.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.
        progress: called every few generations.

    Raises:
        ImportError: pycma is not installed.
        ValueError: no trees, trees for other features or actions, or fewer than two episodes.
    """
    if episodes < 2:
        raise ValueError(f"polishing needs at least 2 episodes, got {episodes}")
    began, before, start = time.perf_counter(), evaluator.steps, first_episode + OBSERVED
    watched = range(first_episode, start)
    found = [TreeParameters.of(tree, evaluator.observe(tree, watched)) for tree in trees]
    runs = [CMAESRun(numbers, seed) for numbers in found if numbers.size]
    generation, schedule = 0, EpisodeSchedule(episodes)

    def spent() -> float:
        """The part of the budget."""
        return max((evaluator.steps - before) / budget.steps, (time.perf_counter() - began) / budget.seconds)

    while runs and min(budget.steps, budget.seconds) > 0 and (so_far := spent()) < 1:
        runs = _better(runs, max(1, len(trees) >> int(so_far * HALVINGS)))
        going_on = [run for run in runs if not run.is_over]
        if not going_on:
            break
        returns = _next_generation(going_on, evaluator, range(start, start := start + schedule.episodes))
        schedule.update(returns)
        generation += 1
        if progress is not None and generation % REPORT_EVERY == 0:
            best = max(runs, key=lambda run: run.mean)
            seconds = time.perf_counter() - began
            progress(FinetuneProgress(best.middle, evaluator.steps - before, seconds, best.mean))
    if not generation:
        return trees[0]
    known = [*trees, *(run.middle for run in _better(runs, 1))]
    judged = evaluator.play(known, range(start, start + JUDGING_FACTOR * schedule.episodes)).returns
    return known[int(judged.mean(axis=1, dtype=np.float64).argmax())]


class CMAESRun:
    """One tree on its way up."""

    def __init__(self, numbers: TreeParameters, seed: int) -> None:
        self.numbers, self._search = numbers, _strategy(numbers.size, seed)
        self._means: list[float] = []

    def sample(self) -> list[DecisionTree]:
        """The next generation."""
        self._steps = self._search.ask()
        return [self.numbers.shifted(step) for step in self._steps]

    def update(self, means: Float[np.ndarray, " trees"]) -> None:
        """Tell the strategy the mean return of each tree of the generation."""
        self._search.tell(self._steps, (-means).tolist())
        self._means.append(float(means.mean()))

    @property
    def middle(self) -> DecisionTree:
        """The tree around which others are sampled."""
        return self.numbers.shifted(self._search.result.xfavorite) if self._means else self.numbers.tree

    @property
    def mean(self) -> float:
        """The mean return of the last few generations, a few thousand episodes."""
        return float(np.mean(self._means[-MEAN_WINDOW:])) if self._means else -math.inf

    @property
    def is_over(self) -> bool:
        """True where nothing is left to gain."""
        return bool(self._search.stop())


def _better(runs: Sequence[CMAESRun], number: int) -> list[CMAESRun]:
    """The best of them, in their order."""
    best = sorted(runs, key=lambda run: -run.mean)[:number]
    return [run for run in runs if run in best]


def _next_generation(
    runs: Sequence[CMAESRun], evaluator: Evaluator, episodes: range
) -> list[GenerationReturns]:
    """All play the same episodes; the returns of each run's trees."""
    sample = [run.sample() for run in runs]
    played = evaluator.play([tree for trees in sample for tree in trees], episodes).returns.astype(np.float64)
    returns = np.split(played, np.cumsum([len(trees) for trees in sample])[:-1])
    for run, rows in zip(runs, returns, strict=True):
        run.update(rows.mean(axis=1))
    return returns


class EpisodeSchedule:
    """The number of episodes of a generation, adapted to how well they rank trees."""

    def __init__(self, episodes: int) -> None:
        self.episodes, self._least = episodes, episodes
        self._agreements: list[float] = []

    def update(self, returns: Sequence[GenerationReturns]) -> None:
        """Adapt the number of episodes to the returns of a generation, one array per run."""
        self._agreements += [agreement(rows) for rows in returns]
        if len(self._agreements) < SCHEDULE_WINDOW * len(returns):
            return
        agreed, (low, high) = float(np.mean(self._agreements)), AGREEMENT_BOUNDS
        self._agreements.clear()
        if agreed < low:
            self.episodes = min(2 * self.episodes, MAX_EPISODE_FACTOR * self._least)
        elif agreed > high:
            self.episodes = max(self.episodes // 2, self._least)


def agreement(returns: GenerationReturns) -> float:
    """Correlation of what trees earn in one half of the episodes with the other; 1 where there is none to differ in."""
    halves = np.stack([returns[:, ::2].mean(axis=1), returns[:, 1::2].mean(axis=1)])
    if (halves.std(axis=1) == 0).any():
        return 1.0
    return float(np.corrcoef(halves)[0, 1])


@dataclass(frozen=True)
class TreeParameters:
    """The numbers of a tree that may move, and how far a step of 1 moves each of them."""

    tree: DecisionTree
    splits: Int[np.ndarray, " thresholds"]
    """Nodes that ask about a number; categories have no threshold worth moving."""
    leaves: Int[np.ndarray, " leaves"]
    """Nodes whose answers are numbers."""
    scale: Float[np.ndarray, " size"]

    @staticmethod
    def of(tree: DecisionTree, seen: Float32[np.ndarray, "steps features"]) -> TreeParameters:
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
        return TreeParameters(tree, splits, leaves, scale)

    @property
    def size(self) -> int:
        """The number of parameters."""
        return len(self.scale)

    def shifted(self, steps: Float[np.ndarray, " size"]) -> DecisionTree:
        """The tree with each number shifted so many steps."""
        way = np.asarray(steps) * self.scale
        threshold, value = self.tree.threshold.copy(), self.tree.leaf_outputs.copy()
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
    rng = SeedStream(seed).generator()
    options = {
        "popsize": POPULATION_FACTOR * (4 + int(3 * math.log(size))),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # do not seed NumPy
        # returns are noisy: neither that the best was long ago nor that it is always the same means much
        "tolstagnation": math.inf,
        "tolfun": 0,
        "tolfunhist": 0,
        "tolflatfitness": FLAT_GENERATIONS,
        "verbose": -10,  # no words, and no file of signals is read
    }
    return CMAEvolutionStrategy(np.zeros(size), INITIAL_STEP, options)
