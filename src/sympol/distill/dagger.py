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
    """Fit trees on all states that the teacher and earlier trees visited, and return the best (Ross et al. 2011).

    Continuous actions are regressed. The teacher plays in the first iteration, the previous tree in all later ones.
    The best tree is chosen by its mean return over validation episodes. If there are more than ``max_samples``
    demonstrations, that many are drawn uniformly.

    Args:
        teacher: The policy to imitate.
        depth: Most comparisons before an answer; see `sympol.distill.distill`.
        num_iterations: Number of trees that are fitted, one after the other.
        episodes_per_iteration: Whole episodes that each tree plays.
        max_samples: Most demonstrations that a tree is fitted on.
        num_validation_episodes: Episodes by which the best tree is chosen.
        seed: The same seed gives the same tree, bit for bit.
        progress: Called after each iteration.
        play_tree: Plays a tree; by default on the teacher's environment.
        max_nodes: Most nodes, leaves included; odd.

    Returns:
        The best tree, not pruned.

    Raises:
        ValueError: an argument out of bounds, or a teacher whose answers do not fit.
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
    """Draw demonstrations without repetition.

    Args:
        collected: All demonstrations.
        at_most: The most to draw.
        rng: The source of randomness.

    Returns:
        All of them, or ``at_most`` if there are more.
    """
    if collected.size <= at_most:
        return collected
    return collected.rows(rng.choice(collected.size, at_most, replace=False))
