"""The methods that make small trees, each one or more tasks that any process can do.

| method | what it does |
|---|---|
| scratch | trains trees by PPO, every other one within the limit of nodes; prunes by return and fine-tunes in turns |
| teacher | trains an MLP by PPO and distils it; prunes by return and fine-tunes in turns |
| teacher, where all states are listed | fits CART to the best memoryless policy (`sympol.search.best_lookup`); prunes |
| evolve | mutates the trees of the other methods, and random trees (`sympol.search.evolve`) |

A task saves its candidates in its folder, so what is finished is not done again.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...compilation import use_disk_cache
from ...distill.cart import fit_cart
from ...envs.registry import resolve
from ...envs.spec import EnvSpec
from ...parallel import Task
from ...results.records import from_fields, to_fields
from ...trees import DecisionTree
from ..best_lookup import best_lookup
from ..budget import Budget, Cost
from ..evaluators.tabular import TabularEvaluator
from ..evolve import EvolutionResult, evolve
from .config import SearchConfig
from .distillation import run_distillation
from .messages import Candidate, TaskRequest, TaskResult, load_candidates, save_candidates, save_progress
from .task import TaskContext, finetune_candidates, prune_candidates, train_policy

TABLE_SEARCH = 0.5
"""The part of a task's budget, at most, for the best table."""
CART_FITS = 4
"""Trees of one table: CART has a choice among splits that are equally good."""
EVOLUTION_EPISODES = {"jax": 256, "native": 32, "host": 16}
"""Episodes of an epoch of evolution, by backend."""
MAX_START_NODES = 127
"""Nodes of the trees that evolution starts from, at most, whatever the limit is."""


def tasks(config: SearchConfig, folder: Path, method: str, budget: Budget, workers: int = 1) -> list[Task]:
    """Return the tasks of a method.

    Args:
        config: The search.
        folder: Its folder.
        method: One of its methods.
        budget: The budget of all tasks of the method together.
        workers: The number of tasks that are done at once.

    Returns:
        Tasks for `sympol.parallel.run_tasks`; each calls `run_task`.
    """
    number = config.number(method)
    turns = math.ceil(number / workers)
    part = Budget(min(budget.steps / number, 1e15), min(budget.seconds / turns, 1e9))
    return [
        Task(
            f"{method} {index + 1} of {number}" if number > 1 else method,
            f"{__name__}:run_task",
            {"request": to_fields(TaskRequest(config, folder, method, index, part))},
        )
        for index in range(number)
    ]


def run_task(request: Mapping[str, Any]) -> dict[str, Any]:
    """Do one task of `tasks`; its candidates are in its folder then.

    Args:
        request: The fields of a `TaskRequest`.

    Returns:
        The fields of a `TaskResult`.

    Raises:
        ValueError: The request is not as its schema says, or the task's saved candidates are damaged.
    """
    use_disk_cache()
    task = from_fields(TaskRequest, request)
    context = TaskContext(task, resolve(task.config.env, env_kwargs=task.config.env_kwargs))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        if not load_candidates(context.folder).finished:
            {"scratch": run_scratch, "teacher": run_teacher, "evolve": run_evolution}[task.method](context)
    messages = (str(one.message) for one in caught if issubclass(one.category, UserWarning))
    return to_fields(TaskResult(tuple(dict.fromkeys(messages))))


def run_scratch(context: TaskContext) -> None:
    """Train a tree by PPO, prune it by return and fine-tune; every other task trains within the limit.

    Args:
        context: The task, in whose folder the candidates are saved.
    """
    limit = 0 if context.request.index % 2 == 0 else context.max_nodes
    agent, cost = train_policy(context, "tree", context.folder / "run", method="direct", max_nodes=limit)
    finetune_candidates(context, prune_candidates(context, agent.tree(), "scratch", cost), "scratch")


def run_teacher(context: TaskContext) -> None:
    """Make trees of a teacher: of the best table where all states are listed, else of a network.

    Args:
        context: The task, in whose folder the candidates are saved.
    """
    if has_state_graph(context.spec) and not context.request.config.teacher:
        run_tabular(context)
    else:
        run_distillation(context)


def has_state_graph(spec: EnvSpec) -> bool:
    """Return True where all states of an environment are listed."""
    return spec.state_graph() is not None


def run_tabular(context: TaskContext) -> None:
    """Search the best memoryless policy as a table, fit trees to it and prune them.

    Args:
        context: The task, in whose folder the candidates are saved.
    """
    began = time.perf_counter()
    table = best_lookup(
        TabularEvaluator(context.spec, context.seed),
        budget=context.budget.part(TABLE_SEARCH),
        seed=context.seed,
    )
    cost = Cost(env_steps=table.steps, seconds=time.perf_counter() - began)
    trees = (
        fit_cart(table.observations, table.actions, context.spec, depth=None, seed=seed)
        for seed in range(CART_FITS)
    )
    candidates: list[Candidate] = []
    for tree in dict.fromkeys(trees):
        candidates += prune_candidates(context, tree, "tabular", cost)
        cost = candidates[-1].cost
    save_candidates(context.folder, candidates, finished=True)


def run_evolution(context: TaskContext) -> None:
    """Mutate the trees of the other methods, and random trees.

    Args:
        context: The task, in whose folder the candidates are saved.
    """
    saved = load_candidates(context.folder).candidates
    done = saved[-1].cost if saved else Cost()
    methods = [method for method in context.request.config.methods if method != "evolve"]
    others = [
        one
        for method in methods
        for folder in sorted((context.request.folder / method).glob("*"))
        for one in load_candidates(folder).candidates
    ]
    name = " + ".join([*methods, "evolve"]) if others else "evolve"
    starts = [one.tree for one in (*others, *saved) if one.tree.n_nodes <= MAX_START_NODES]

    def save(epoch: EvolutionResult, *, finished: bool = False) -> None:
        cost = done + Cost(env_steps=epoch.steps, seconds=epoch.seconds)
        candidates = (Candidate(tree, name, cost) for tree in epoch.trees)
        save_candidates(context.folder, candidates, finished=finished)
        save_progress(context.folder, epoch.best)

    last = evolve(
        context.evaluator(),
        starts or [_single_leaf(context.spec)],
        max_nodes=context.max_nodes,
        budget=Budget(context.budget.steps - done.env_steps, context.budget.seconds - done.seconds),
        episodes=EVOLUTION_EPISODES[context.spec.backend],
        seed=context.seed,
        progress=save,
    )
    save(last, finished=True)


def _single_leaf(spec: EnvSpec) -> DecisionTree:
    """Return a tree of one leaf, from which evolution can start."""
    none = np.zeros(0, int), np.zeros(0), np.zeros((1, spec.actions.n_outputs))
    return DecisionTree.from_complete(*none, actions=spec.actions, **spec.features.metadata())
