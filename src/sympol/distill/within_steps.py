"""Distillation within a number of environment steps: the smallest tree that is about as good as the best.

Dataset aggregation as in `imitate`, in few turns. Trees of several sizes are then fitted on everything collected, and
all play the same validation episodes. The smallest tree wins whose mean return is within one standard error of the
best one's (Breiman et al. 1984, section 3.4.3), and not much lower whatever that error is.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..envs.spec import EnvSpec
from ..play import Act, Episodes, Purpose, play
from ..seeds import SeedStream
from ..trees import DecisionTree
from .cart import fit_cart
from .dagger import draw_uniformly
from .dataset import Demonstrations, Limits, labelled
from .imitate import iteration_seed
from .teacher import Teacher
from .viper import draw_by_loss, losses

TURNS = 8
"""Trees that collect observations, one after the other, after the teacher."""
COLLECTING = 0.6
"""The part of the steps in which observations are collected; by the others the tree is chosen."""
LEAVES = (4, 8, 16, 32, 64, 128)
"""Numbers of leaves that are tried."""
MIDDLE = 16
"""The number of leaves where there is no time to choose."""
FEW = 8
"""Episodes after which their mean length is believed; until then the number played doubles."""
LOSS = 0.05
"""The part of what the best tree earns above random actions that a smaller one may lose."""
MAX_SAMPLES = 100_000
"""The most demonstrations that a tree is fitted on."""


class Distilled(NamedTuple):
    """A distilled tree, and what it was compared with.

    Attributes:
        tree: The tree, not pruned.
        tree_return: Its mean return.
        tree_length: The mean length of its episodes.
        teacher_return: The mean return of the teacher.
        random_return: The mean return of random actions.
        teacher_is_better: Whether the teacher earned more than random actions by more than a standard error.
        num_steps: The environment steps that were played.
    """

    tree: DecisionTree
    tree_return: float
    tree_length: float
    teacher_return: float
    random_return: float
    teacher_is_better: bool
    num_steps: int


def distill_within(teacher: Teacher, num_steps: int, *, limits: Limits, seed: int) -> Distilled:
    """Distill a tree, playing about a given number of environment steps.

    States are drawn by VIPER's losses where the teacher has action values, else uniformly.

    Args:
        teacher: The policy to imitate.
        num_steps: Environment steps to play, about. Episodes are played to their end, at least one at
            random, one by the teacher and two by trees.
        limits: Limits of the tree's size.
        seed: The same seed gives the same tree, bit for bit.

    Returns:
        The tree and the returns.

    Raises:
        ValueError: The teacher's answers do not fit.
    """
    spec, weighted = teacher.spec, teacher.action_values is not None
    draw = draw_by_loss if weighted else draw_uniformly
    weigh = (lambda x: losses(teacher, x)) if weighted else None
    player, sizes = _Player(spec), _sizes(limits)

    def fit(collected: Demonstrations, turn: int, leaves: int) -> DecisionTree:
        sample = draw(collected, MAX_SAMPLES, SeedStream(seed, turn).generator())
        nodes = 2 * leaves - 1
        return fit_cart(
            sample.observations, sample.actions, spec, seed=seed, depth=limits.depth, max_nodes=nodes
        )

    share = COLLECTING * num_steps / (TURNS + 2)
    (by_chance,) = player.play([_random(teacher, seed)], share, iteration_seed(seed, 0), "distill")
    (played,) = player.play([teacher], share, iteration_seed(seed, 0), "distill")
    teacher_returns, collected = played.returns, labelled(teacher, played.observations, weigh)
    best, best_return = None, -np.inf
    for turn in range(1, TURNS + 1):
        if turn > 1 and player.steps > COLLECTING * num_steps:
            break
        tree = fit(collected, turn, sizes[-1])
        (played,) = player.play([tree], share, iteration_seed(seed, turn), "distill")
        collected = collected.joined(labelled(teacher, played.observations, weigh))
        if played.returns.mean() >= best_return:
            best, best_return = tree, played.returns.mean()
    left = num_steps - player.steps
    if left < (len(sizes) + 1) * played.lengths.mean():
        sizes, best = [min(MIDDLE, sizes[-1])], None
    trees = [fit(collected, TURNS + 1, leaves) for leaves in sizes] + ([] if best is None else [best])
    validations = player.play(trees, left, seed, "validation")
    returns = [validation.returns for validation in validations]
    chosen = _smallest(returns, by_chance.returns.mean())
    return Distilled(
        trees[chosen],
        float(returns[chosen].mean()),
        float(validations[chosen].lengths.mean()),
        float(teacher_returns.mean()),
        float(by_chance.returns.mean()),
        _is_better(teacher_returns, by_chance.returns),
        player.steps,
    )


class _Player:
    """Plays episodes in an environment and counts their steps."""

    def __init__(self, spec: EnvSpec) -> None:
        self.spec, self.steps = spec, 0

    def play(
        self,
        policies: Sequence[DecisionTree | Teacher | Act],
        num_steps: float,
        seed: int,
        purpose: Purpose,
    ) -> list[Episodes]:
        """Play the same episodes with several policies, as many as there is time for, and at least one."""
        played, number = [[] for _ in policies], 0
        while True:
            taken = sum(int(episodes.lengths.sum()) for of_one in played for episodes in of_one)
            has_time_for = int(number * (num_steps - taken) / taken) if number else 1
            more = has_time_for if number >= FEW else min(has_time_for, max(number, 1))
            if more < 1:
                break
            for policy, of_one in zip(policies, played, strict=True):
                of_one.append(self._play(policy, more, SeedStream(seed, number).seed(), purpose))
            number += more
        return [Episodes(*map(np.concatenate, zip(*of_one, strict=True))) for of_one in played]

    def _play(
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
    return sorted({min(leaves, most) for leaves in LEAVES})


def _smallest(returns: Sequence[np.ndarray], by_chance: float) -> int:
    """Return the first of several policies that is about as good as the best one, episode by episode."""
    best = returns[int(np.argmax([r.mean() for r in returns]))]
    most = LOSS * max(0.0, best.mean() - by_chance)
    return next(i for i, r in enumerate(returns) if (best - r).mean() <= min(_standard_error(best - r), most))


def _is_better(returns: np.ndarray, others: np.ndarray) -> bool:
    """Return whether returns are higher than others by more than a standard error."""
    error = np.hypot(_standard_error(returns), _standard_error(others))
    return bool(returns.mean() - others.mean() > error)


def _standard_error(differences: np.ndarray) -> float:
    """Return the standard error of a mean; 0 for a single number."""
    return float(differences.std(ddof=1) / np.sqrt(len(differences))) if len(differences) > 1 else 0.0
