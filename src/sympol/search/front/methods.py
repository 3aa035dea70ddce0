"""The methods that make small trees, each one or more tasks that any process can run.

| method | what it does |
|---|---|
| scratch | trains trees by PPO, every other one within the limit of nodes; prunes by return and fine-tunes in turns |
| teacher | trains an MLP by PPO and distils it; prunes by return and fine-tunes in turns |
| teacher, where all states are listed | fits CART to the best memoryless policy (`sympol.search.best_lookup`); prunes |
| evolve | mutates what the other methods found, and random trees (`sympol.search.evolve`) |

A task saves its candidates in its folder, so what is finished is not done again.
"""

from __future__ import annotations

import json
import math
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ... import files
from ...compilation import use_disk_cache
from ...distill.cart import fit_cart
from ...envs.registry import resolve
from ...envs.spec import EnvSpec
from ...parallel import Task
from ...trees import DecisionTree
from ..best_lookup import best_lookup
from ..budget import Budget
from ..evaluators import make_evaluator
from ..evaluators.tabular import TabularEvaluator
from ..evolve import EvolutionResult, evolve
from .candidates import PROGRESS, Candidate, load_candidates, save_candidates
from .config import SearchConfig
from .context import TRAINING, TaskContext, prune_candidates, scale_budget, train_policy
from .distillation_method import run_distillation
from .finetune_schedule import finetune_candidates
from .front import Cost

SEARCHING = 0.5
"""Of the share, at most, for the table."""
FITS = 4
"""Trees of one table: CART has a choice among splits that are equally good."""


def is_known(spec: EnvSpec) -> bool:
    """Return True where all states of an environment are listed."""
    return spec.state_graph() is not None


def run_tabular(context: TaskContext) -> None:
    """Run the method; its candidates are saved in the context's folder."""
    began = time.perf_counter()
    table = best_lookup(
        TabularEvaluator(context.spec, context.seed),
        budget=scale_budget(context.share, SEARCHING),
        seed=context.seed,
    )
    cost = Cost(env_steps=table.steps, seconds=time.perf_counter() - began)
    trees = (
        fit_cart(table.observations, table.actions, context.spec, depth=None, seed=seed)
        for seed in range(FITS)
    )
    found: list[Candidate] = []
    for tree in dict.fromkeys(trees):
        found += prune_candidates(context, tree, "lookup", found[-1].cost if found else cost)
    save_candidates(context.folder, found, finished=True)


EPISODES = {"jax": 256, "native": 32, "host": 16}
"""Episodes in which evolution compares, by what steps them."""
LARGEST = 127
"""Nodes of the trees that evolution starts from, at most, however small those are that are asked for."""


def tasks(plan: SearchConfig, folder: Path, road: str, share: Budget, workers: int = 1) -> list[Task]:
    """Return the tasks of a method; ``share`` is its budget, ``workers`` the number of tasks that run at once."""
    number = plan.number(road)
    turns = math.ceil(number / workers)
    return [
        Task(
            f"{road} {i + 1} of {number}" if number > 1 else road,
            f"{__name__}:run_task",
            {
                "plan": plan.to_dict(),
                "folder": str(folder),
                "road": road,
                "index": i,
                "seconds": min(share.seconds / turns, 1e9),
                "steps": min(share.steps / number, 1e15),
            },
        )
        for i in range(number)
    ]


def place(folder: Path, road: str, index: int) -> Path:
    """Return the folder of a task."""
    return folder / road / str(index)


def run_task(
    plan: dict[str, Any], folder: str, road: str, index: int, seconds: float, steps: float
) -> list[str]:
    """Do one task of `tasks`; what it has found is in its `place` then. Return what was warned of."""
    use_disk_cache()
    asked = SearchConfig.from_dict(plan)
    spec = resolve(asked.env, env_kwargs=asked.env_kwargs)
    context = TaskContext(
        asked, spec, Path(folder), index, place(Path(folder), road, index), Budget(steps, seconds)
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        if not load_candidates(context.folder)[1]:
            {"scratch": _scratch, "teacher": _teacher, "evolve": _evolve}[road](context)
    return list(dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, UserWarning)))


def _scratch(context: TaskContext) -> None:
    limit = 0 if context.index % 2 == 0 else context.plan.max_nodes
    agent, spent = train_policy(
        context, "tree", context.folder / "run", scale_budget(context.share, TRAINING), max_nodes=limit
    )
    found = prune_candidates(context, agent.tree(), "scratch", spent)
    save_candidates(context.folder, found, finished=False)
    finetune_candidates(context, found, "scratch")


def _teacher(context: TaskContext) -> None:
    (run_tabular if is_known(context.spec) and not context.plan.teacher else run_distillation)(context)


def _evolve(context: TaskContext) -> None:
    before, _ = load_candidates(context.folder)
    done = before[-1].cost if before else Cost()
    roads = [road for road in context.plan.methods if road != "evolve"]
    others = [
        one
        for road in roads
        for folder in sorted((context.root / road).glob("*"))
        for one in load_candidates(folder)[0]
    ]
    name = " + ".join([*roads, "evolve"]) if others else "evolve"
    starts = [one.tree for one in (*others, *before) if one.tree.n_nodes <= LARGEST]
    evaluator = make_evaluator(context.spec, context.seed)

    def found(heat: EvolutionResult) -> list[Candidate]:
        here = done + Cost(env_steps=heat.steps, seconds=heat.seconds)
        return [Candidate(tree, name, here) for tree in heat.trees]

    def tell(heat: EvolutionResult) -> None:
        save_candidates(context.folder, found(heat), finished=False)
        files.write(context.folder / PROGRESS, json.dumps(heat.best))

    left = Budget(context.share.steps - done.env_steps, context.share.seconds - done.seconds)
    last = evolve(
        evaluator,
        starts or [_indifferent(context.spec)],
        max_nodes=context.plan.max_nodes,
        budget=left,
        episodes=EPISODES[context.spec.backend],
        seed=context.seed,
        progress=tell,
    )
    save_candidates(context.folder, found(last), finished=True)


def _indifferent(spec: EnvSpec) -> DecisionTree:
    """One leaf, for evolution to begin with."""
    none = np.zeros(0, int), np.zeros(0), np.zeros((1, spec.actions.n_outputs))
    return DecisionTree.from_complete(*none, actions=spec.actions, **spec.features.metadata())
