"""The steps that methods share: train a policy, prune a tree by return, prune and fine-tune in turns.

`finetune_candidates` begins with trees of twice the limit. They are fine-tuned
(`sympol.search.finetune_thresholds`), pruned by return to the limit and fine-tuned again; then pruned to four fifths
of their nodes and fine-tuned again, and so on down to a quarter of the limit: fine-tuning recovers what little each
pruning loses. As the features that a tree tests limit how good it can become, splits are exchanged
(`sympol.search.insert_splits`) for as long as its size has time.

Each size saves its candidates in a folder of its own: what is finished is not repeated, and fine-tuning resumes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...agents import PPO, Agent, Callback, Report
from ...envs.spec import EnvSpec
from ...runs.run import Run
from ...seeds import EpisodeBlock, SeedStream
from ...training import finish, has_run, resume_agent, save_into
from ...trees import BoxActions, DecisionTree
from ..budget import Budget, Cost, Meter
from ..evaluators import Evaluator, make_evaluator
from ..finetune_thresholds import FinetuneProgress, finetune_thresholds
from ..insert_splits import resplit
from ..prune_by_return import prune_path
from .messages import Candidate, TaskRequest, load_candidates, save_candidates

TRAINING = 0.5
"""The part of a task's budget, at most, for the training that a method begins with."""
STEPS_TO_HALF = 3
"""The number of steps in which a tree within the limit loses half of its nodes."""
FIRST_SIZE = 2
"""The size of the first trees, as a multiple of the limit."""
TARGET_WEIGHT, SMALL_WEIGHT = 4.0, 0.5
"""The time of trees of the limit and of half of it, and of those of less than half, where others have 1: re-splitting
makes more of more time, and smaller trees start from what these became."""
FIRST_FINETUNING = 0.25
"""The part of a size's time for fine-tuning before splits are exchanged; in the largest size none are."""
STARTS = 2
"""Trees that are fine-tuned side by side at first."""
HALVING_EPISODES = 32, 128
"""Episodes in which starts are chosen: for all trees, and for the best few."""
EPISODES = {"jax": 64, "native": 32, "host": 16}
"""Episodes of a generation of fine-tuning, by backend."""
FINE_TUNING = EpisodeBlock(1 << 30, 1 << 30)
"""The episodes of fine-tuning; whatever else a search plays has lower numbers."""
MAX_STAGES = 32
"""Parts of these episodes, one for each size."""
MAX_RESPLITS = 16
"""How often the splits of one size are exchanged at most; the second half of its episodes is divided among them."""


@dataclass(frozen=True)
class TaskContext:
    """A task that is being done: its request, and the environment."""

    request: TaskRequest
    spec: EnvSpec

    @property
    def folder(self) -> Path:
        """The folder of the task."""
        return self.request.task_folder

    @property
    def budget(self) -> Budget:
        """The budget of the task."""
        return self.request.budget

    @property
    def max_nodes(self) -> int:
        """The limit of nodes of the search."""
        return self.request.config.max_nodes

    @property
    def stream(self) -> SeedStream:
        """The stream of seeds of the task."""
        return SeedStream(self.request.config.seed, self.request.index, self.request.method)

    @property
    def seed(self) -> int:
        """The seed of the task's trainings and evaluators."""
        return self.stream.seed()

    def evaluator(self) -> Evaluator:
        """Return a new evaluator on the task's episodes."""
        return make_evaluator(self.spec, self.seed)


def train_policy(context: TaskContext, policy: str, folder: Path, **options: Any) -> tuple[Agent, Cost]:
    """Train in a run's folder, or resume there, until the end or until the budget of trainings is spent.

    Args:
        context: The task.
        policy: The kind of policy, such as ``"tree"`` or ``"mlp"``.
        folder: The run's folder.
        **options: Hyperparameters of PPO.

    Returns:
        The agent, and the cost of its training.
    """
    began, budget = time.perf_counter(), context.budget.part(TRAINING)
    if has_run(folder):
        run = Run.open(folder)
        agent = resume_agent(run)
    else:
        agent = PPO(policy, context.spec, seed=context.seed, **options)
        if budget.steps < agent.config.total_timesteps:
            agent = PPO(policy, context.spec, seed=context.seed, total_timesteps=int(budget.steps), **options)
        run = Run.create(folder, context.spec, agent.config, agent.seed, overwrite=True, start=agent.start)

    def in_time(report: Report) -> bool:
        return time.perf_counter() - began < budget.seconds

    callbacks: list[Callback] = [save_into(run), in_time]
    with run:
        if agent.num_timesteps < agent.config.total_timesteps:
            agent.learn(callback=callbacks, progress_bar=False)
        run.save_summary(finish(agent, run, None, None, 0))
    return agent, Cost(env_steps=agent.num_timesteps, seconds=time.perf_counter() - began)


def prune_candidates(
    context: TaskContext, tree: DecisionTree, method: str, cost: Cost, smallest: int = 1
) -> list[Candidate]:
    """Return a tree and ever smaller prunings of it.

    Args:
        context: The task.
        tree: The tree to prune by return.
        method: The methods that made it.
        cost: Its cost so far.
        smallest: The number of nodes at which to stop, odd.

    Returns:
        The candidates, the largest first; each has the cost of the whole path.
    """
    evaluator = context.evaluator()
    meter = Meter(evaluator)
    path = prune_path(tree, evaluator, smallest=smallest, observations=context.spec.all_observations())
    cost += Cost.of(meter)
    return [Candidate(one.tree, f"{method} + prune" if i else method, cost) for i, one in enumerate(path)]


def finetune_candidates(context: TaskContext, candidates: Sequence[Candidate], method: str) -> None:
    """Prune and fine-tune a method's candidates size by size; all of them are saved in the task's folder.

    Args:
        context: The task.
        candidates: The candidates that the method has so far, at least one.
        method: The method that made them.
    """
    candidates = list(candidates)
    for stage in stages(context.max_nodes) if has_numbers(context.spec) else ():
        save_candidates(context.folder, candidates, finished=False)
        candidates += _finetuned_at(context, candidates, stage, f"{method} + fine-tune")
    save_candidates(context.folder, candidates, finished=True)


def has_numbers(spec: EnvSpec) -> bool:
    """Return True where there is something to fine-tune: a numeric feature or a continuous action."""
    categories = sum(len(group.features) for group in spec.features.groups)
    return categories < len(spec.features.names) or isinstance(spec.actions, BoxActions)


@dataclass(frozen=True)
class Stage:
    """A size at which trees are fine-tuned."""

    nodes: int
    """The largest number of nodes."""
    next_nodes: int
    """The number of nodes to which the tree is pruned afterwards."""
    part: float
    """The part of the steps and seconds that are left."""
    episodes: EpisodeBlock


def stages(max_nodes: int) -> list[Stage]:
    """Return the sizes from twice the limit down to a quarter of it, as long as trees have a split.

    Args:
        max_nodes: The limit of nodes, odd.

    Returns:
        The stages, the largest first; together they spend all there is.
    """
    ratios = np.array([FIRST_SIZE, *(2.0 ** (-np.arange(2 * STEPS_TO_HALF + 1) / STEPS_TO_HALF))])
    leaves = np.floor((max_nodes + 1) / 2 * ratios + 1e-9).astype(int)
    sizes = [2 * n - 1 for n in dict.fromkeys(leaves.tolist()) if n > 1 < max_nodes]
    weights = [_weight(size, max_nodes) for size in sizes]
    return [
        Stage(size, smaller, weights[i] / sum(weights[i:]), FINE_TUNING.part(i, MAX_STAGES))
        for i, (size, smaller) in enumerate(zip(sizes, [*sizes, 1][1:], strict=True))
    ]


def _weight(size: int, max_nodes: int) -> float:
    """Return how long a size has, in comparison with others."""
    half = (max_nodes - 1) // 2
    if size == max_nodes or half <= size <= half + 1:
        return TARGET_WEIGHT
    return 1.0 if size > half else SMALL_WEIGHT


def _finetuned_at(
    context: TaskContext, candidates: Sequence[Candidate], stage: Stage, method: str
) -> Sequence[Candidate]:
    """Fine-tune the best of the trees that are no larger than a stage, and prune them to the next one."""
    folder = context.folder / f"{stage.nodes}-nodes"
    saved = load_candidates(folder)
    if saved.finished:
        return saved.candidates
    evaluator = context.evaluator()
    meter, before = Meter(evaluator), candidates[-1].cost
    if saved.candidates:
        starts, done = [saved.candidates[0].tree], saved.candidates[0].cost
    else:
        starts, done = _best_below(stage.nodes, candidates, evaluator), before

    def save(tree: DecisionTree) -> None:
        save_candidates(folder, [Candidate(tree, method, done + Cost.of(meter))], finished=False)

    def save_progress(progress: FinetuneProgress) -> None:
        save(progress.tree)

    def left(part: float) -> Budget:
        """Return what is left of a part of the size's time."""
        whole, part, now = context.budget, part * stage.part, done + Cost.of(meter)
        return Budget(
            (whole.steps - before.steps) * part - (now.steps - before.steps),
            (whole.seconds - before.seconds) * part - (now.seconds - before.seconds),
        )

    episodes = EPISODES[context.spec.backend]
    resplits = MAX_RESPLITS if stage.nodes <= context.max_nodes else 0
    tree = finetune_thresholds(
        starts,
        evaluator,
        budget=left(FIRST_FINETUNING if resplits else 1.0),
        episodes=episodes,
        first_episode=stage.episodes.start,
        seed=context.seed,
        progress=save_progress,
    )
    for turn in range(resplits):
        budget = left(1.0)
        if min(budget.steps, budget.seconds) <= 0:
            break
        tree = resplit(
            tree,
            evaluator,
            max_nodes=stage.nodes,
            budget=budget,
            episodes=episodes,
            first_episode=stage.episodes.part(1, 2).part(turn, MAX_RESPLITS).start,
            seed=context.stream.seed(turn),
        )
        save(tree)
    pruned = prune_candidates(context, tree, method, done + Cost.of(meter), smallest=stage.next_nodes)
    save_candidates(folder, pruned, finished=True)
    return pruned


def _best_below(nodes: int, candidates: Sequence[Candidate], evaluator: Evaluator) -> list[DecisionTree]:
    """Return the best of the trees of at most so many nodes, and of more than half as many if there are such."""
    fit = [one.tree for one in candidates if one.tree.n_nodes <= nodes]
    return best_by_halving(evaluator, [tree for tree in fit if tree.n_nodes > nodes // 2] or fit, STARTS)


def best_by_halving(evaluator: Evaluator, trees: Sequence[DecisionTree], number: int) -> list[DecisionTree]:
    """Return the best of some trees: all play a few episodes, the best few of them more.

    Args:
        evaluator: The evaluator that plays the trees.
        trees: The trees; equal ones count once.
        number: How many to return at most.

    Returns:
        The trees with the highest mean return, the best first.
    """
    trees = list(dict.fromkeys(trees))
    for episodes, kept in zip(HALVING_EPISODES, (2 * number, number), strict=True):
        means = evaluator.play(trees, range(episodes)).returns.mean(axis=1, dtype=np.float64)
        trees = [trees[i] for i in np.argsort(-means, kind="stable")[:kept]]
    return trees
