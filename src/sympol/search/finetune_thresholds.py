"""Fine-tune all thresholds of a tree at once by an evolution strategy.

CMA-ES (Hansen and Ostermeier 2001; the implementation is pycma's) samples trees around the present one, lets them play,
and moves towards those that earned more, along directions that it learns. In a generation all play the same episodes,
in the next one others, so that the mean return is optimised and not the return of particular episodes. The features
that splits test and the actions of discrete leaves stay as they are; continuous actions are fine-tuned, too.

The better the trees become, the less their returns differ, and the more episodes it takes to rank them. So the ranking
by one half of the episodes is compared with that by the other half. Where they hardly agree, later generations play
twice as many; where they agree well, half as many.

Distances are measured in the spread of what the tree observes: a step of 1 is one standard deviation of the feature, or
half the range of an action.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Float32, Int

from ..seeds import SeedStream
from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.floats import flushed
from .budget import Budget, Meter
from .evaluators.base import Evaluator

POPULATION_FACTOR = 2
"""Sampled trees, as a multiple of the default of CMA-ES: the mean of many noisy trees errs less. On LunarLander this
was better than twice the episodes, or than four times the trees."""
INITIAL_STEP = 0.1
"""The standard deviation of the first trees around the start."""
OBSERVED = 16
"""Episodes that are observed to measure the spread of features."""
REPORT_EVERY = 4
"""Generations between two reports."""
SCHEDULE_WINDOW = 8
"""Generations after which the number of episodes is adapted."""
AGREEMENT_BOUNDS = (0.25, 0.6)
"""Correlation of returns between the halves of the episodes: below the first number there are more episodes, above
the second fewer."""
MAX_EPISODE_FACTOR = 4
"""The largest number of episodes, as a multiple of the first."""
HALVINGS = 4
"""Parts of a budget, after each of which the better half of the trees continues."""
MEAN_WINDOW = 5
"""Generations whose mean return decides that."""
FLAT_GENERATIONS = 10
"""Generations in which all trees earn the same, after which a run ends."""
FINAL_FACTOR = 4
"""Episodes of the final comparison, as a multiple of those of a generation."""


class FinetuneProgress(NamedTuple):
    """The state of fine-tuning, which ``progress`` receives every few generations."""

    tree: DecisionTree
    """The best tree so far: the mean of the search distribution."""
    steps: int
    """Environment steps so far."""
    seconds: float
    mean: float
    """The mean return of the last few generations."""


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
    """Fine-tune trees side by side and return the best of them.

    How good a tree can become depends on the features it tests. So several start side by side; after a quarter of
    the budget the better half of them continues, after the next quarter half of these, and so on.

    Args:
        trees: Trees of any sizes, at least one.
        evaluator: The evaluator that plays the trees.
        budget: How long to search; it ends with the generation that spends it, or where nothing is left to gain.
        episodes: Episodes of the first generations, the same ones for all trees of a generation.
        first_episode: The first episode that is played.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.
        progress: Called every few generations.

    Returns:
        The best fine-tuned tree; one of ``trees`` where that earns more in other episodes. It keeps its size, but some
        of its splits may have become redundant: prune it.

    Raises:
        ImportError: pycma is not installed.
        ValueError: No trees, trees for other features or actions, or fewer than two episodes.
    """
    if episodes < 2:
        raise ValueError(f"fine-tuning needs at least 2 episodes, got {episodes}")
    meter, start = Meter(evaluator), first_episode + OBSERVED
    observed = range(first_episode, start)
    parameters = [TreeParameters.of(tree, evaluator.observe(tree, observed)) for tree in trees]
    runs = [CMAESRun(one, seed) for one in parameters if one.size]
    generation, schedule = 0, EpisodeSchedule(episodes)
    while runs and min(budget.steps, budget.seconds) > 0 and (spent := meter.fraction(budget)) < 1:
        runs = _better(runs, max(1, len(trees) >> int(spent * HALVINGS)))
        active = [run for run in runs if not run.is_over]
        if not active:
            break
        returns = _next_generation(active, evaluator, range(start, start := start + schedule.episodes))
        schedule.update(returns)
        generation += 1
        if progress is not None and generation % REPORT_EVERY == 0:
            best = max(runs, key=lambda run: run.mean)
            progress(FinetuneProgress(best.middle, meter.steps, meter.seconds, best.mean))
    if not generation:
        return trees[0]
    finalists = [*trees, *(run.middle for run in _better(runs, 1))]
    returns = evaluator.play(finalists, range(start, start + FINAL_FACTOR * schedule.episodes)).returns
    return finalists[int(returns.mean(axis=1, dtype=np.float64).argmax())]


class CMAESRun:
    """CMA-ES on the parameters of one tree.

    Args:
        parameters: The parameters that it changes.
        seed: The seed of its samples.
    """

    def __init__(self, parameters: TreeParameters, seed: int) -> None:
        self.parameters, self._search = parameters, _strategy(parameters.size, seed)
        self._means: list[float] = []

    def sample(self) -> list[DecisionTree]:
        """Return the trees of the next generation."""
        self._steps = self._search.ask()
        return [self.parameters.shifted(step) for step in self._steps]

    def update(self, means: Float[np.ndarray, " trees"]) -> None:
        """Move towards the trees that earned more.

        Args:
            means: The mean return of each tree of the generation.
        """
        self._search.tell(self._steps, (-means).tolist())
        self._means.append(float(means.mean()))

    @property
    def middle(self) -> DecisionTree:
        """The tree around which the next generation is sampled."""
        return self.parameters.shifted(self._search.result.xfavorite) if self._means else self.parameters.tree

    @property
    def mean(self) -> float:
        """The mean return of the last few generations."""
        return float(np.mean(self._means[-MEAN_WINDOW:])) if self._means else -math.inf

    @property
    def is_over(self) -> bool:
        """True where the strategy expects no further gain."""
        return bool(self._search.stop())


def _better(runs: Sequence[CMAESRun], number: int) -> list[CMAESRun]:
    """Return the best runs, in their order."""
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
    """The number of episodes of a generation, adapted to how well they rank trees.

    Args:
        episodes: The first number, and the smallest.
    """

    def __init__(self, episodes: int) -> None:
        self.episodes, self._least = episodes, episodes
        self._agreements: list[float] = []

    def update(self, returns: Sequence[GenerationReturns]) -> None:
        """Adapt the number of episodes.

        Args:
            returns: The returns of a generation ``[trees, episodes]``, one array for each run.
        """
        self._agreements += [agreement(rows) for rows in returns]
        if len(self._agreements) < SCHEDULE_WINDOW * len(returns):
            return
        mean, (low, high) = float(np.mean(self._agreements)), AGREEMENT_BOUNDS
        self._agreements.clear()
        if mean < low:
            self.episodes = min(2 * self.episodes, MAX_EPISODE_FACTOR * self._least)
        elif mean > high:
            self.episodes = max(self.episodes // 2, self._least)


def agreement(returns: GenerationReturns) -> float:
    """Return how well two halves of some episodes agree in ranking trees.

    Args:
        returns: The returns ``[trees, episodes]``.

    Returns:
        The correlation of the mean returns; 1 where all trees earn the same in one of the halves.
    """
    halves = np.stack([returns[:, ::2].mean(axis=1), returns[:, 1::2].mean(axis=1)])
    if (halves.std(axis=1) == 0).any():
        return 1.0
    return float(np.corrcoef(halves)[0, 1])


@dataclass(frozen=True)
class TreeParameters:
    """The numbers of a tree that may change, and how far a step of 1 changes each of them."""

    tree: DecisionTree
    splits: Int[np.ndarray, " thresholds"]
    """Nodes that test a numeric feature; for categories no threshold is better than another."""
    leaves: Int[np.ndarray, " leaves"]
    """Leaves whose actions are continuous."""
    scale: Float[np.ndarray, " size"]

    @staticmethod
    def of(tree: DecisionTree, seen: Float32[np.ndarray, "steps features"]) -> TreeParameters:
        """Return the parameters of a tree.

        Args:
            tree: The tree.
            seen: Observations ``[steps, features]`` that it acts on; thresholds of a feature that never differs there
                stay as they are.

        Returns:
            The parameters, with the spread of each feature as its scale.
        """
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
        """Return the tree with each parameter shifted.

        Args:
            steps: How far, in multiples of ``scale``.

        Returns:
            A tree of the same shape.
        """
        shift = np.asarray(steps) * self.scale
        threshold, value = self.tree.threshold.copy(), self.tree.leaf_outputs.copy()
        n = len(self.splits)
        threshold[self.splits] = flushed(np.float32(threshold[self.splits] + shift[:n]))
        if len(self.leaves):
            value[self.leaves] = np.float32(value[self.leaves] + shift[n:].reshape(len(self.leaves), -1))
        return replace(self.tree, threshold=threshold, value=value, n_node_samples=None)


def _strategy(size: int, seed: int) -> Any:
    """Return pycma's CMA-ES with a random generator of its own in place of NumPy's global one."""
    try:
        from cma import CMAEvolutionStrategy
    except ImportError as error:
        raise ImportError(
            "fine-tuning a tree needs pycma, which is not installed; install it: pip install 'sympol[bench]'"
        ) from error
    rng = SeedStream(seed).generator()
    options = {
        "popsize": POPULATION_FACTOR * (4 + int(3 * math.log(size))),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,  # do not seed NumPy
        # returns are noisy: an old best value, or the same one many times, is no reason to stop
        "tolstagnation": math.inf,
        "tolfun": 0,
        "tolfunhist": 0,
        "tolflatfitness": FLAT_GENERATIONS,
        "verbose": -10,  # print nothing, and read no file of signals
    }
    return CMAEvolutionStrategy(np.zeros(size), INITIAL_STEP, options)
