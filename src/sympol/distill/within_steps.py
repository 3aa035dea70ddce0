"""Distillation within a number of environment steps: the smallest tree that is about as good as the best.

Dataset aggregation as in `imitate`, in few turns. Trees of several sizes are then fitted on everything collected, and
all play the same validation episodes. The smallest tree wins whose mean return is within one standard error of the
best one's (Breiman et al. 1984, section 3.4.3).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..play import Act, Episodes, Purpose, play
from ..seeds import SeedStream
from ..trees import DecisionTree
from .cart import fit_cart
from .dagger import draw_uniformly
from .dataset import Limits, labelled
from .imitate import iteration_seed
from .teacher import Teacher
from .viper import draw_by_loss, losses

TURNS = 3
"""Trees that collect observations, besides the teacher."""
LEAVES = (4, 8, 16, 32, 64, 128)
"""Numbers of leaves that are tried."""
MIDDLE = 16
"""The number of leaves where there are too few episodes to choose by."""
FEWEST = 2
"""Episodes of one kind from which a standard error is computed."""
MAX_SAMPLES = 100_000
"""The most demonstrations that a tree is fitted on."""


class Distilled(NamedTuple):
    """A distilled tree, and what it was compared with.

    Attributes:
        tree: The tree, not pruned.
        tree_return: Its mean return.
        teacher_return: The mean return of the teacher.
        random_return: The mean return of random actions.
        teacher_is_better: Whether the teacher earned more than random actions by more than a standard error.
        num_steps: The environment steps that were played.
    """

    tree: DecisionTree
    tree_return: float
    teacher_return: float
    random_return: float
    teacher_is_better: bool
    num_steps: int


def distill_within(teacher: Teacher, num_steps: int, *, limits: Limits, seed: int) -> Distilled:
    """Distill a tree, playing about a given number of environment steps.

    States are drawn by VIPER's losses where the teacher has action values, else uniformly.

    Args:
        teacher: The policy to imitate.
        num_steps: Environment steps to play, about. Episodes are played to their end, at least one by the teacher,
            one at random and one by a tree.
        limits: Limits of the tree's size.
        seed: The same seed gives the same tree, bit for bit.

    Returns:
        The tree and the returns.

    Raises:
        ValueError: The teacher's answers do not fit.
        ImportError: scikit-learn is not installed.
    """
    spec, weighted = teacher.spec, teacher.action_values is not None
    draw = draw_by_loss if weighted else draw_uniformly
    weigh = (lambda x: losses(teacher, x)) if weighted else None
    counter = _Counter(teacher)
    first = counter.play(teacher, 1, seed, "distill")
    sizes = _sizes(limits)
    kinds = 2 + TURNS + len(sizes)
    number = max(1, int((num_steps - counter.steps) / (kinds * max(first.lengths[0], 1))))

    its = counter.play(teacher, number, iteration_seed(seed, 0), "distill")
    by_chance = counter.play(_random(teacher, seed), number, iteration_seed(seed, 0), "distill")
    collected = labelled(teacher, np.concatenate([first.observations, its.observations]), weigh)

    def fit(turn: int, leaves: int) -> DecisionTree:
        sample = draw(collected, MAX_SAMPLES, SeedStream(seed, turn).generator())
        nodes = None if leaves == 0 else 2 * leaves - 1
        return fit_cart(
            sample.observations, sample.actions, spec, seed=seed, depth=limits.depth, max_nodes=nodes
        )

    for turn in range(1, TURNS + 1):
        played = counter.play(fit(turn, sizes[-1]), number, iteration_seed(seed, turn), "distill")
        collected = collected.joined(labelled(teacher, played.observations, weigh))
        if counter.steps >= num_steps:
            break
    has_room = counter.steps < num_steps and number >= FEWEST
    sizes = sizes if has_room else sizes[: max(1, sum(leaves <= MIDDLE for leaves in sizes))][-1:]
    trees = [fit(TURNS + 1, leaves) for leaves in sizes]
    returns = [counter.play(tree, number, seed, "validation").returns for tree in trees]
    chosen = _smallest(returns)
    gained = its.returns - by_chance.returns
    return Distilled(
        trees[chosen],
        float(returns[chosen].mean()),
        float(its.returns.mean()),
        float(by_chance.returns.mean()),
        bool(gained.mean() > _standard_error(gained)),
        counter.steps,
    )


class _Counter:
    """Plays episodes in the teacher's environment and counts their steps."""

    def __init__(self, teacher: Teacher) -> None:
        self.spec, self.steps = teacher.spec, 0

    def play(
        self, policy: DecisionTree | Teacher | Act, number: int, seed: int, purpose: Purpose
    ) -> Episodes:
        played = play(policy, self.spec, number, seed=seed, purpose=purpose)
        self.steps += int(played.lengths.sum())
        return played


def _random(teacher: Teacher, seed: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return a policy of random actions."""
    space = copy.deepcopy(teacher.spec.action_space)
    space.seed(SeedStream(seed, "random").seed())
    return lambda x: np.stack([space.sample() for _ in x])


def _sizes(limits: Limits) -> list[int]:
    """Return the numbers of leaves to try, at most those of the limits."""
    most = LEAVES[-1] if limits.depth is None else 2**limits.depth
    most = most if limits.max_nodes is None else min(most, (limits.max_nodes + 1) // 2)
    return [leaves for leaves in LEAVES if leaves < most] + [min(most, LEAVES[-1])]


def _smallest(returns: Sequence[np.ndarray]) -> int:
    """Return the first of several policies that is within a standard error of the best one, episode by episode."""
    best = returns[int(np.argmax([r.mean() for r in returns]))]
    return next(i for i, r in enumerate(returns) if (best - r).mean() <= _standard_error(best - r))


def _standard_error(differences: np.ndarray) -> float:
    """Return the standard error of a mean; 0 for a single number."""
    return float(differences.std(ddof=1) / np.sqrt(len(differences))) if len(differences) > 1 else 0.0
