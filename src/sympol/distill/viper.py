"""VIPER: verifiable reinforcement learning via policy extraction (Bastani, Pu and Solar-Lezama, NeurIPS 2018)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from ..trees import DecisionTree
from ..trees.actions import BoxActions
from .dataset import Demonstrations, Limits
from .imitate import Play, Progress, Schedule, imitate
from .teacher import Teacher


def viper(
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
    """Fit trees as `dagger` does, on states drawn in proportion to the possible cost of a wrong action.

    The cost of a state is ℓ(s) = max_a Q(s, a) − min_a Q(s, a). For a policy-gradient teacher Q = log π: under
    maximum entropy π(a | s) ∝ exp Q(s, a), and terms that depend on s alone cancel. Each iteration draws as many
    states, with replacement, as there are, and ``max_samples`` at most.

    Args:
        teacher: The policy to imitate, with action values.
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
        ValueError: continuous actions, a teacher without action values, an argument out of bounds, or a teacher
            whose answers do not fit.
    """
    actions = teacher.spec.actions
    if isinstance(actions, BoxActions):
        raise ValueError(
            f"viper needs a discrete action space, got {teacher.spec.action_space} of {teacher.spec.name}: it weighs "
            "states by the values of all actions; for continuous actions use the method dagger"
        )
    if teacher.action_values is None:
        raise ValueError(
            "viper needs a teacher with action values, to know which states matter, got one without; give it "
            "action_values (Q-values or log-probabilities), or use the method dagger"
        )
    schedule = Schedule(num_iterations, episodes_per_iteration, max_samples, num_validation_episodes)
    return imitate(
        teacher,
        schedule,
        limits=Limits.of(depth, max_nodes),
        seed=seed,
        draw=draw_by_loss,
        losses=lambda x: losses(teacher, x),
        progress=progress,
        play_tree=play_tree,
    )


def losses(teacher: Teacher, x: np.ndarray) -> Float64[np.ndarray, " samples"]:
    """Compute the losses ℓ(s) = max_a Q(s, a) − min_a Q(s, a), summed over the components of an action.

    The log-probability of several choices at once is the sum of theirs, and so are its maximum and minimum.

    Args:
        teacher: A teacher with action values.
        x: Flat observations.

    Returns:
        The loss of each observation.
    """
    actions = teacher.spec.actions
    assert teacher.action_values is not None
    assert not isinstance(actions, BoxActions)
    parts = actions.split(teacher.action_values(x))
    return np.sum([part.max(axis=1) - part.min(axis=1) for part in parts], axis=0)


def draw_by_loss(collected: Demonstrations, at_most: int, rng: np.random.Generator) -> Demonstrations:
    """Draw demonstrations with replacement in proportion to their losses, or uniformly if all losses are zero.

    Args:
        collected: All demonstrations, with losses.
        at_most: The most to draw.
        rng: The source of randomness.

    Returns:
        As many as there are, but at most ``at_most``.
    """
    weights = collected.losses
    assert weights is not None
    total = weights.sum()
    chances = weights / total if total > 0 else None
    return collected.rows(rng.choice(collected.size, min(collected.size, at_most), p=chances))
