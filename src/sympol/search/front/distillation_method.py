"""Distillation: a network becomes a large tree, which is pruned and fine-tuned in turns.

1. A teacher is trained, or given.
2. It is distilled into several trees that may be four times as large as those asked for: what a large tree earns, a
   small one pruned out of it by return can earn, too, while a small one that only imitates earns next to nothing.
3. The best two are pruned by return to twice the limit and fine-tuned, which leaves the better one; it is pruned to
   the limit, fine-tuned again, and so on (`sympol.search.front.finetune_schedule`): CART puts thresholds where the
   teacher's answers change,
   and not where the tree, which is cruder, had better change its own.

Each tree is kept when it is there. What is done is not done again.
"""

from __future__ import annotations

import time
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
from ..evaluators import Evaluator, make_evaluator
from .candidates import Candidate, load_candidates, save_candidates
from .context import TRAINING, TaskContext, prune_candidates, scale_budget, train_policy
from .finetune_schedule import STARTS, best_by_halving, finetune_candidates, stages
from .front import Cost

DISTILLING = 0.7
"""Of the share of seconds, after which no further tree is distilled."""
TIMES = (4, 4, 4, 4)
"""How large distilled trees may be, in limits."""
EPISODES = {"jax": 128, "native": 128, "host": 16}
"""Of an iteration of distillation, by what steps them."""
DISTILLATION, BLOCKS = EpisodeBlock(1 << 10, 1 << 29), 1 << 19
"""The episodes in which distilled trees are played, and their blocks, of which a seed draws one."""
ITERATIONS = 12
"""Trees that are fitted one after the other, of which distillation takes the best."""


def run_distillation(context: TaskContext) -> None:
    """Run the method; its candidates are saved in the context's folder."""
    found = _distilled(context)
    save_candidates(context.folder, found, finished=False)
    finetune_candidates(context, found, "teacher")


def _distilled(context: TaskContext) -> list[Candidate]:
    """Return trees distilled from the teacher, the best of them pruned by return to the first size."""
    folder = context.folder / "distilled"
    before, finished = load_candidates(folder)
    if finished:
        return before
    if context.plan.teacher:
        teacher, cost = _load_teacher(context), Cost()
    else:
        teacher, spent = train_policy(
            context, "mlp", context.folder / "teacher", scale_budget(context.share, TRAINING)
        )
        cost = Cost(teacher_steps=spent.env_steps, seconds=spent.seconds)
    asked = as_teacher(teacher)
    warn_of_poor_teacher(asked)
    trees = _trees(context, teacher, asked, before, cost)
    evaluator, began = make_evaluator(context.spec, context.seed), time.perf_counter()
    best = best_by_halving(evaluator, [one.tree for one in trees], STARTS)
    cost = trees[-1].cost + Cost(env_steps=evaluator.steps, seconds=time.perf_counter() - began)
    found, largest = list(trees), stages(context.plan.max_nodes)[0].nodes
    for tree in best:
        found += prune_candidates(context, tree, "teacher", cost, smallest=largest)
        cost = found[-1].cost
    within = [one for one in found if one.tree.n_nodes <= largest]
    save_candidates(folder, within, finished=True)
    return within


def _trees(
    context: TaskContext, policy: Any, teacher: Teacher, before: Sequence[Candidate], cost: Cost
) -> list[Candidate]:
    """Large trees that imitate the teacher, besides those of ``before``, as many as time allows; one at least."""
    episodes, found = EPISODES[context.spec.backend], list(before)
    soft = default_method(policy, teacher) == DISCRETIZE
    limits = [0] if soft else [max(3, times * (context.plan.max_nodes + 1) - 1) for times in TIMES]
    for i, limit in list(enumerate(limits))[len(before) :]:
        spent = found[-1].cost if found else cost
        if found and spent.seconds > DISTILLING * context.share.seconds:
            break
        evaluator, began = make_evaluator(context.spec, context.seed), time.perf_counter()
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
        spent += Cost(env_steps=evaluator.steps, seconds=time.perf_counter() - began)
        found.append(Candidate(tree, "teacher", spent))
        save_candidates(context.folder / "distilled", found, finished=False)
    return found


def distillation_player(evaluator: Evaluator) -> Play:
    """The evaluator as distillation plays trees: on episodes far from those that pruning plays.

    Only where something is to be learnt from what was seen it is observed, which takes as long again.
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


def _load_teacher(context: TaskContext) -> Any:
    path = Path(context.plan.teacher)
    if path.is_dir():
        return load(path)
    return load_sb3(
        path, resolve(context.plan.env, env_kwargs=context.plan.env_kwargs, backend="host"), trust=False
    )


def warn_of_poor_teacher(teacher: Teacher) -> None:
    """Say so where a teacher earns less than chance does."""
    space = teacher.spec.action_space
    space.seed(0)
    its = play(teacher, teacher.spec, 10, seed=0, purpose="distill").returns.mean()
    chance = play(
        lambda x: np.stack([space.sample() for _ in x]), teacher.spec, 10, seed=0, purpose="distill"
    )
    if its < chance.returns.mean():
        warnings.warn(
            f"the teacher earns {its:.1f}, less than a random policy does, {chance.returns.mean():.1f}; its trees "
            "will be poor",
            stacklevel=2,
        )
