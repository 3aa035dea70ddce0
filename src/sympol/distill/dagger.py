"""DAgger with trees, for every kind of action."""

from __future__ import annotations

import numpy as np

from ..trees import DecisionTree
from .dataset import Demonstrations, Limits
from .imitate import Play, Progress, Schedule, imitate
from .teacher import Teacher


def dagger(
    teacher: Teacher,
    depth: int | None = None,
    num_iterations: int = 20,
    episodes_per_iteration: int = 10,
    max_samples: int = 100_000,
    num_validation_episodes: int = 20,
    seed: int = 0,
    progress: Progress | None = None,
    play_tree: Play | None = None,
    max_nodes: int | None = None,
) -> DecisionTree:
    """Fit trees on all states that the teacher and earlier trees came by (Ross et al. 2011); return the best.

    Continuous actions are regressed. Of the first iteration the teacher is the player, of all later ones the tree
    before; the best is chosen by mean return over validation episodes. Of more than ``max_samples`` demonstrations
    so many are drawn, without regard to what they cost. The same seed gives the same tree, bit for bit.
    ``depth`` and ``max_nodes`` are as of `distill`.

    Raises:
        ValueError: an argument out of bounds, or a teacher whose answers do not fit.
        ImportError: scikit-learn is not installed.
    """
    schedule = Schedule(num_iterations, episodes_per_iteration, max_samples, num_validation_episodes)
    return imitate(
        teacher,
        schedule,
        limits=Limits.of(depth, max_nodes),
        seed=seed,
        draw=draw_uniformly,
        progress=progress,
        play_tree=play_tree,
    )


def draw_uniformly(collected: Demonstrations, at_most: int, rng: np.random.Generator) -> Demonstrations:
    """All of them, or so many of them without repetition."""
    if collected.size <= at_most:
        return collected
    return collected.rows(rng.choice(collected.size, at_most, replace=False))
