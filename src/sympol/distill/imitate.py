"""The loop of dataset aggregation that `dagger` and `viper` share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from ..play import Episodes, Purpose, play
from ..seeds import SeedStream
from ..trees import DecisionTree
from .cart import fit_cart
from .dataset import Demonstrations, Limits, Losses, labelled, require_positive, require_seed
from .teacher import Teacher

Draw: TypeAlias = Callable[[Demonstrations, int, np.random.Generator], Demonstrations]
"""From all demonstrations, and how many there may be at most, to those that the next tree is fitted on."""


Play: TypeAlias = Callable[[DecisionTree, int, int, Purpose], Episodes]
"""A tree in so many episodes out of a seed, to learn from or to choose by; with another seed or purpose, others."""

FINALISTS = 5
"""Of how many trees, those that did best while they collected, the validation episodes choose one."""


class Iteration(NamedTuple):
    """The argument of ``progress`` after each tree.

    Attributes:
        iteration: The number of the iteration, from one.
        num_iterations: The number of iterations.
        num_samples: The number of demonstrations so far, of all iterations.
        mean_return: The mean return of this tree over the episodes that it plays next.
    """

    iteration: int
    num_iterations: int
    num_samples: int
    mean_return: float
    best_return: float
    """The highest of these so far."""


Progress: TypeAlias = Callable[[Iteration], object]


@dataclass(frozen=True)
class Schedule:
    """The length of the learning, and the amount of data.

    Attributes:
        num_iterations: The number of iterations.
        episodes_per_iteration: The number of episodes played in each.
        max_samples: The most demonstrations that a tree is fitted on.
        num_validation_episodes: The number of episodes that choose among the best trees.

    Raises:
        ValueError: A number is below one.
    """

    num_iterations: int
    episodes_per_iteration: int
    max_samples: int
    num_validation_episodes: int

    def __post_init__(self) -> None:
        """Check."""
        require_positive(**vars(self))


class Candidate(NamedTuple):
    """A tree, and its mean return over episodes that it was not fitted on.

    Attributes:
        mean_return: The mean return.
        tree: The tree.
    """

    mean_return: float
    tree: DecisionTree


def imitate(
    teacher: Teacher,
    schedule: Schedule,
    *,
    limits: Limits,
    seed: int,
    draw: Draw,
    losses: Losses | None = None,
    progress: Progress | None = None,
    play_tree: Play | None = None,
) -> DecisionTree:
    """Aggregate demonstrations (DAgger, Ross et al. 2011) and return the best of the trees fitted on them.

    The teacher plays the first episodes, then each tree plays those that the next one learns from besides all
    earlier ones; the teacher says what it would have done. Every tree plays once more than the last one learns, so
    that each has a mean return on episodes new to it; the best few of them then play the same validation episodes,
    which nothing learns from and which alone decide. Trees play on Gymnasium, or by ``play_tree``.
    """
    require_seed(seed)
    spec, num_episodes = teacher.spec, schedule.episodes_per_iteration
    play_tree = play_tree or on_gymnasium(teacher)
    played = play(teacher, spec, num_episodes, seed=seed, purpose="distill")
    collected = labelled(teacher, played.observations, losses)
    candidates: list[Candidate] = []
    for i in range(1, schedule.num_iterations + 1):
        sample = draw(collected, schedule.max_samples, SeedStream(seed, i).generator())
        tree = fit_cart(sample.observations, sample.actions, spec, seed=seed, **limits._asdict())
        played = play_tree(tree, num_episodes, iteration_seed(seed, i), "distill")
        candidates.append(Candidate(float(played.returns.mean()), tree))
        if progress is not None:
            best = max(candidate.mean_return for candidate in candidates)
            done = (i, schedule.num_iterations, collected.size, candidates[-1].mean_return, best)
            progress(Iteration(*done))
        if i < schedule.num_iterations:
            collected = collected.joined(labelled(teacher, played.observations, losses))
    return best_of(candidates, play_tree, schedule.num_validation_episodes, seed)


def on_gymnasium(teacher: Teacher) -> Play:
    """Return a function that plays episodes in the environment in which a teacher acts.

    Args:
        teacher: The teacher.

    Returns:
        A function from a tree, a number of episodes, a seed and a purpose to their results.
    """
    return lambda tree, number, seed, purpose: play(tree, teacher.spec, number, seed=seed, purpose=purpose)


def best_of(candidates: Sequence[Candidate], play_tree: Play, num_episodes: int, seed: int) -> DecisionTree:
    """Return the finalist with the highest mean return over validation episodes, the same ones for all.

    Of equal ones the later wins, because it was fitted on more data.

    Args:
        candidates: The trees, in the order in which they were fitted.
        play_tree: The function that plays.
        num_episodes: The number of validation episodes.
        seed: Their seed.

    Returns:
        The tree.
    """
    later_first = candidates[::-1]
    finalists = sorted(later_first, key=lambda candidate: -candidate.mean_return)[:FINALISTS]
    returns = [
        play_tree(finalist.tree, num_episodes, seed, "validation").returns.mean() for finalist in finalists
    ]
    return finalists[int(np.argmax(returns))].tree


def iteration_seed(seed: int, iteration: int) -> int:
    """Return the seed of the episodes of an iteration, another than in all others and than the teacher's own.

    Args:
        seed: The seed of the distillation, with which the teacher plays.
        iteration: The number of the iteration.

    Returns:
        The seed.
    """
    return SeedStream(seed, iteration).seed()
