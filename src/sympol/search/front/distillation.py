"""Distillation: a network becomes large trees, the best of which are pruned by return and fine-tuned in turns.

1. A teacher is trained, or given.
2. It is distilled into several trees that may be four times as large as the limit: what a large tree earns, a small
   one pruned out of it by return can earn, too, while a small one that only imitates earns next to nothing.
3. The best two are pruned by return to twice the limit, from where `sympol.search.front.task.finetune_candidates`
   continues: CART puts thresholds where the teacher's actions change, and not where the tree, which is cruder, had
   better change its own.

Each tree is saved as soon as it is there.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...agents import load
from ...distill import Teacher, load_sb3
from ...distill.imitate import Play
from ...envs.registry import resolve
from ...play import Episodes, Purpose, play
from ...seeds import EpisodeBlock, SeedStream
from ...teachers import DISCRETIZE, as_teacher, default_method, distill_policy
from ...trees import DecisionTree
from ..budget import Cost, Meter
from ..evaluators import Evaluator
from .config import SearchConfig
from .messages import Candidate, load_candidates, save_candidates
from .task import (
    STARTS,
    TaskContext,
    best_by_halving,
    finetune_candidates,
    prune_candidates,
    stages,
    train_policy,
)

DISTILLING = 0.7
"""The part of a task's seconds after which no further tree is distilled."""
DISTILLED_SIZES = (4, 4, 4, 4)
"""How large each distilled tree may be, as a multiple of the limit."""
DISTILLATION_EPISODES = {"jax": 128, "native": 128, "host": 16}
"""Episodes of an iteration of distillation, by backend."""
ITERATIONS = 12
"""Trees that an iteration of distillation fits one after the other, and of which it takes the best."""
DISTILLATION, BLOCKS = EpisodeBlock(1 << 10, 1 << 29), 1 << 19
"""The episodes in which distilled trees are played, and their number of blocks, of which a seed draws one."""


def run_distillation(context: TaskContext) -> None:
    """Distil a teacher into large trees; prune the best of them by return and fine-tune in turns.

    Args:
        context: The task, in whose folder the candidates are saved.
    """
    saved = load_candidates(context.folder / "distilled")
    if saved.finished:
        candidates = list(saved.candidates)
    else:
        candidates = _distilled(context, saved.candidates)
        save_candidates(context.folder / "distilled", candidates, finished=True)
    finetune_candidates(context, candidates, "teacher")


def _distilled(context: TaskContext, saved: Sequence[Candidate]) -> list[Candidate]:
    """Return trees distilled from the teacher, the best of them pruned by return to the first size."""
    config = context.request.config
    if config.teacher:
        policy, cost = _load_teacher(config), Cost()
    else:
        policy, training = train_policy(context, "mlp", context.folder / "teacher")
        cost = Cost(teacher_steps=training.env_steps, seconds=training.seconds)
    teacher = as_teacher(policy)
    warn_of_poor_teacher(teacher)
    candidates = distilled_trees(context, policy, teacher, saved, cost)
    evaluator = context.evaluator()
    meter = Meter(evaluator)
    best = best_by_halving(evaluator, [one.tree for one in candidates], STARTS)
    cost = candidates[-1].cost + Cost.of(meter)
    largest = stages(context.max_nodes)[0].nodes
    for tree in best:
        candidates += prune_candidates(context, tree, "teacher", cost, smallest=largest)
        cost = candidates[-1].cost
    return [one for one in candidates if one.tree.n_nodes <= largest]


def distilled_trees(
    context: TaskContext, policy: Any, teacher: Teacher, saved: Sequence[Candidate], cost: Cost
) -> list[Candidate]:
    """Return large trees that imitate the teacher: at least one, and as many as time allows.

    Args:
        context: The task; each tree is saved in its folder as soon as it is there.
        policy: The teacher as it was trained or loaded.
        teacher: The same as a teacher.
        saved: Trees that were distilled before an interruption.
        cost: The cost of the teacher.

    Returns:
        The saved trees and the new ones.
    """
    episodes, candidates = DISTILLATION_EPISODES[context.spec.backend], list(saved)
    soft = default_method(policy, teacher) == DISCRETIZE
    limits = [0] if soft else [max(3, times * (context.max_nodes + 1) - 1) for times in DISTILLED_SIZES]
    for i, limit in list(enumerate(limits))[len(saved) :]:
        cost = candidates[-1].cost if candidates else cost
        if candidates and cost.seconds > DISTILLING * context.budget.seconds:
            break
        evaluator = context.evaluator()
        meter = Meter(evaluator)
        if soft:
            tree = distill_policy(policy, DISCRETIZE, env=teacher.spec)
        else:
            tree = distill_policy(
                policy,
                "dagger",
                env=teacher.spec,
                seed=context.stream.seed(i),
                max_nodes=limit,
                num_iterations=ITERATIONS,
                episodes_per_iteration=episodes,
                num_validation_episodes=2 * episodes,
                play_tree=distillation_player(evaluator),
            )
        candidates.append(Candidate(tree, "teacher", cost + Cost.of(meter)))
        save_candidates(context.folder / "distilled", candidates, finished=False)
    return candidates


def distillation_player(evaluator: Evaluator) -> Play:
    """Return the evaluator as distillation plays trees, on episodes that nothing else plays.

    Observations are only collected where something is learnt from them, as that takes as long again.

    Args:
        evaluator: The evaluator that plays the trees.

    Returns:
        A function of a tree, a number of episodes, a seed and a purpose.
    """

    def play_tree(tree: DecisionTree, number: int, seed: int, purpose: Purpose) -> Episodes:
        block = SeedStream(seed, purpose == "distill").seed() % BLOCKS
        episodes = range(first := DISTILLATION.part(block, BLOCKS).start, first + number)
        played = evaluator.play([tree], episodes)
        seen = np.zeros((0, tree.n_features), np.float32)
        if purpose == "distill":
            seen = evaluator.observe(tree, episodes)
        return Episodes(played.returns[0], played.lengths[0], seen)

    return play_tree


def _load_teacher(config: SearchConfig) -> Any:
    path = Path(config.teacher)
    if path.is_dir():
        return load(path)
    return load_sb3(path, resolve(config.env, env_kwargs=config.env_kwargs, backend="host"), trust=False)


def warn_of_poor_teacher(teacher: Teacher) -> None:
    """Warn where a teacher earns less than random actions do.

    Args:
        teacher: The teacher; it plays ten episodes, and so do random actions.
    """
    space = teacher.spec.action_space
    space.seed(0)
    earned = play(teacher, teacher.spec, 10, seed=0, purpose="distill").returns.mean()
    chance = play(
        lambda x: np.stack([space.sample() for _ in x]), teacher.spec, 10, seed=0, purpose="distill"
    ).returns.mean()
    if earned < chance:
        warnings.warn(
            f"the teacher earns {earned:.1f}, less than a random policy does, {chance:.1f}; its trees will be poor",
            stacklevel=2,
        )
