"""Prune and fine-tune in turns, from trees of twice the limit down to a quarter of it.

A tree of twice the limit is fine-tuned (`sympol.search.finetune_thresholds`), pruned by return to the limit and
fine-tuned again; then pruned to four fifths of its nodes and fine-tuned again, and so on down to a quarter of the
limit: fine-tuning recovers what little each pruning loses. As the features that a tree tests limit how good it can
become, splits are exchanged (`sympol.search.insert_splits`) for as long as its size has time.

Each size saves its candidates in a folder of its own: what is finished is not repeated, and fine-tuning resumes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...envs.spec import EnvSpec
from ...seeds import EpisodeBlock
from ...trees import BoxActions, DecisionTree
from ..budget import Budget
from ..evaluators import Evaluator, make_evaluator
from ..finetune_thresholds import FinetuneProgress, finetune_thresholds
from ..insert_splits import resplit
from .candidates import Candidate, load_candidates, save_candidates
from .context import TaskContext, prune_candidates
from .front import Cost

STEPS = 3
"""In which a tree within the limit loses half of its nodes."""
ABOVE = 2
"""How large the first trees are, in limits."""
ASKED_PART, SMALL_PART = 4.0, 0.5
"""How long trees of the limit and of half of it have, and those of less than that, where others have 1: the more time
for other questions, the more they earn, and what is below starts from what they became."""
POLISHING = 0.25
"""Of a size's time, before it gets other questions; the largest has no others."""
STARTS = 2
"""Trees that are fine-tuned side by side at first."""
FIRST, LAST = 32, 128
"""Episodes of a race: for all, and for the best few."""
FINE_TUNING = EpisodeBlock(1 << 30, 1 << 30)
"""The episodes of fine-tuning; whatever else a search plays has lower numbers."""
MAX_STAGES = 32
"""Parts of these episodes, one for each size."""
EPISODES = {"jax": 64, "native": 32, "host": 16}
"""Episodes of a generation of fine-tuning, by backend."""
MAX_RESPLITS = 16
"""How often the splits of one size are exchanged at most; its second half of the episodes is divided among them."""


def finetune_candidates(context: TaskContext, found: Sequence[Candidate], road: str) -> list[Candidate]:
    """Fine-tune a method's candidates size by size; return all, which are also saved in the context's folder."""
    found = list(found)
    for stage in stages(context.plan.max_nodes) if has_numbers(context.spec) else ():
        found += _at(context, found, stage, f"{road} + polish")
        save_candidates(context.folder, found, finished=False)
    save_candidates(context.folder, found, finished=True)
    return found


def has_numbers(spec: EnvSpec) -> bool:
    """Return True where there is something to fine-tune: a numeric feature or a continuous action."""
    categories = sum(len(group.features) for group in spec.features.groups)
    return categories < len(spec.features.names) or isinstance(spec.actions, BoxActions)


@dataclass(frozen=True)
class Stage:
    """A size at which trees are fine-tuned."""

    nodes: int
    """At most."""
    next_nodes: int
    """To which the tree is pruned afterwards."""
    part: float
    """Of the steps and seconds that are left."""
    episodes: EpisodeBlock


def stages(max_nodes: int) -> list[Stage]:
    """Return the sizes from twice the limit down to a quarter of it, as long as trees have a split."""
    ratios = np.array([ABOVE, *(2.0 ** (-np.arange(2 * STEPS + 1) / STEPS))])
    leaves = np.floor((max_nodes + 1) / 2 * ratios + 1e-9).astype(int)
    sizes = [2 * n - 1 for n in dict.fromkeys(leaves.tolist()) if n > 1 < max_nodes]
    parts = [_part(size, max_nodes) for size in sizes]
    return [
        Stage(size, end, parts[i] / sum(parts[i:]), FINE_TUNING.part(i, MAX_STAGES))
        for i, (size, end) in enumerate(zip(sizes, [*sizes, 1][1:], strict=True))
    ]


def _part(size: int, max_nodes: int) -> float:
    """How long a size has."""
    half = (max_nodes - 1) // 2
    if size == max_nodes or half <= size <= half + 1:
        return ASKED_PART
    return 1.0 if size > half else SMALL_PART


def _at(context: TaskContext, found: Sequence[Candidate], stage: Stage, road: str) -> list[Candidate]:
    """Fine-tune the best of the trees that are no larger, and prune them by return."""
    folder = context.folder / f"{stage.nodes}-nodes"
    before, finished = load_candidates(folder)
    if finished:
        return before
    evaluator, began = make_evaluator(context.spec, context.seed), time.perf_counter()
    road_so_far = found[-1].cost
    if before:
        starts, done = [before[0].tree], before[0].cost
    else:
        starts, done = _best_below(stage.nodes, found, evaluator), road_so_far

    def spent() -> Cost:
        return done + Cost(env_steps=evaluator.steps, seconds=time.perf_counter() - began)

    def tell(now: FinetuneProgress) -> None:
        save_candidates(folder, [Candidate(now.tree, road, spent())], finished=False)

    def left(part: float) -> Budget:
        """Of so much of the size's time."""
        share, part, here = context.share, part * stage.part, spent()
        return Budget(
            (share.steps - road_so_far.steps) * part - (here.steps - road_so_far.steps),
            (share.seconds - road_so_far.seconds) * part - (here.seconds - road_so_far.seconds),
        )

    episodes = EPISODES[context.spec.backend]
    polishing = POLISHING if stage.nodes <= context.plan.max_nodes else 1.0
    better = finetune_thresholds(
        starts,
        evaluator,
        budget=left(polishing),
        episodes=episodes,
        first_episode=stage.episodes.start,
        seed=context.seed,
        progress=tell,
    )
    for turn in range(MAX_RESPLITS if polishing < 1 else 0):
        budget = left(1.0)
        if min(budget.steps, budget.seconds) <= 0:
            break
        better = resplit(
            better,
            evaluator,
            max_nodes=stage.nodes,
            budget=budget,
            episodes=episodes,
            first_episode=stage.episodes.part(1, 2).part(turn, MAX_RESPLITS).start,
            seed=context.stream.seed(turn),
        )
        save_candidates(folder, [Candidate(better, road, spent())], finished=False)
    more = prune_candidates(context, better, road, spent(), smallest=stage.next_nodes)
    save_candidates(folder, more, finished=True)
    return more


def _best_below(nodes: int, found: Sequence[Candidate], evaluator: Evaluator) -> list[DecisionTree]:
    """The best of the trees that have at most so many nodes, and more than half as many if there are such."""
    fit = [one.tree for one in found if one.tree.n_nodes <= nodes]
    return best_by_halving(evaluator, [tree for tree in fit if tree.n_nodes > nodes // 2] or fit, STARTS)


def best_by_halving(evaluator: Evaluator, trees: Sequence[DecisionTree], number: int) -> list[DecisionTree]:
    """The best of some different trees: all play a few episodes, the best few of them more."""
    trees = list(dict.fromkeys(trees))
    for episodes, kept_on in ((FIRST, 2 * number), (LAST, number)):
        means = evaluator.play(trees, range(episodes)).returns.mean(axis=1, dtype=np.float64)
        trees = [trees[i] for i in np.argsort(-means, kind="stable")[:kept_on]]
    return trees
