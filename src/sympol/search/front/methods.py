"""Roads to small trees. Each is a task of its own, for any process to do, and leaves what it found in its folder.

| road | what |
|---|---|
| scratch | trees trained by PPO, every other one within the limit of nodes; pruned by return and polished in turns |
| teacher | an MLP trained by PPO, distilled; pruned by return and polished in turns |
| evolve | whatever the other roads found, and random trees, changed at random (`sympol.search.evolve`) |
"""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ... import files
from ...compilation import use_disk_cache
from ...envs.registry import resolve
from ...envs.spec import EnvSpec
from ...parallel import Task
from ...trees import DecisionTree
from ..evaluators.base import make_arena
from ..evolve import Budget, Heat, evolve
from .candidates import HEAT, Found, keep, kept
from .config import Plan
from .context import TRAINING, Site, chained, part, trained
from .distillation_method import taught
from .finetune_schedule import polished
from .front import Spent
from .tabular_method import is_known, looked_up

EPISODES = {"jax": 256, "native": 32, "host": 16}
"""Episodes in which evolution compares, by what steps them."""
LARGEST = 127
"""Nodes of the trees that evolution starts from, at most, however small those are that are asked for."""


def tasks(plan: Plan, folder: Path, road: str, share: Budget, workers: int = 1) -> list[Task]:
    """What a road is made of. ``share`` is its part of the budget, ``workers`` how many go it side by side."""
    number = plan.number(road)
    turns = math.ceil(number / workers)
    return [
        Task(
            f"{road} {i + 1} of {number}" if number > 1 else road,
            f"{__name__}:walk",
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
    """Where a task leaves what it found."""
    return folder / road / str(index)


def walk(plan: dict[str, Any], folder: str, road: str, index: int, seconds: float, steps: float) -> list[str]:
    """Do one task of `tasks`; what it has found is in its `place` then. Return what was warned of."""
    use_disk_cache()
    asked = Plan.from_dict(plan)
    spec = resolve(asked.env, env_kwargs=asked.env_kwargs)
    site = Site(asked, spec, Path(folder), index, place(Path(folder), road, index), Budget(steps, seconds))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        if not kept(site.folder)[1]:
            {"scratch": _scratch, "teacher": _teacher, "evolve": _evolve}[road](site)
    return list(dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, UserWarning)))


def _scratch(site: Site) -> None:
    limit = 0 if site.index % 2 == 0 else site.plan.max_nodes
    agent, spent = trained(site, "tree", site.folder / "run", part(site.share, TRAINING), max_nodes=limit)
    found = chained(site, agent.tree(), "scratch", spent)
    keep(site.folder, found, finished=False)
    polished(site, found, "scratch")


def _teacher(site: Site) -> None:
    (looked_up if is_known(site.spec) and not site.plan.teacher else taught)(site)


def _evolve(site: Site) -> None:
    before, _ = kept(site.folder)
    done = before[-1].spent if before else Spent()
    roads = [road for road in site.plan.roads if road != "evolve"]
    others = [
        one for road in roads for folder in sorted((site.root / road).glob("*")) for one in kept(folder)[0]
    ]
    name = " + ".join([*roads, "evolve"]) if others else "evolve"
    starts = [one.tree for one in (*others, *before) if one.tree.n_nodes <= LARGEST]
    arena = make_arena(site.spec, site.seed)

    def found(heat: Heat) -> list[Found]:
        here = done + Spent(env_steps=heat.steps, seconds=heat.seconds)
        return [Found(tree, name, here) for tree in heat.trees]

    def tell(heat: Heat) -> None:
        keep(site.folder, found(heat), finished=False)
        files.write(site.folder / HEAT, json.dumps(heat.best))

    left = Budget(site.share.steps - done.env_steps, site.share.seconds - done.seconds)
    last = evolve(
        arena,
        starts or [_indifferent(site.spec)],
        max_nodes=site.plan.max_nodes,
        budget=left,
        episodes=EPISODES[site.spec.backend],
        seed=site.seed,
        progress=tell,
    )
    keep(site.folder, found(last), finished=True)


def _indifferent(spec: EnvSpec) -> DecisionTree:
    """One leaf, for evolution to begin with."""
    none = np.zeros(0, int), np.zeros(0), np.zeros((1, spec.actions.n_outputs))
    return DecisionTree.from_complete(*none, actions=spec.actions, **spec.features.metadata())
