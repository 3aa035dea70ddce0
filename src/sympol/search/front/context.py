"""Where a road is built: a task's folder, its share of the budget, and what all roads do there."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...agents import PPO, Agent, Callback, Report
from ...envs.spec import EnvSpec
from ...runs.run import Run
from ...training import finish, go_on, has_run, keep_in
from ...trees import DecisionTree
from ..evaluators.base import make_arena
from ..evolve import Budget
from ..prune_by_return import chain
from .candidates import Found
from .config import Plan
from .front import Spent

TRAINING = 0.5
"""Of a share, at most, for the training that a road begins with."""


@dataclass(frozen=True)
class Site:
    """Where a road is built, and with what."""

    plan: Plan
    spec: EnvSpec
    root: Path
    """The search's folder."""
    index: int
    folder: Path
    """This task's."""
    share: Budget

    @property
    def seed(self) -> int:
        """Of everything random in this task."""
        words = [self.plan.seed, self.index, *self.folder.parent.name.encode()]
        return int(np.random.SeedSequence(words).generate_state(1)[0])


def trained(site: Site, policy: str, folder: Path, share: Budget, **options: Any) -> tuple[Agent, Spent]:
    """Train in a run's folder, or go on there, until the end or until the share is spent."""
    began = time.perf_counter()
    if has_run(folder):
        run = Run.open(folder)
        agent = go_on(run)
    else:
        agent = PPO(policy, site.spec, seed=site.seed, **options)
        if share.steps < agent.config.total_timesteps:
            agent = PPO(policy, site.spec, seed=site.seed, total_timesteps=int(share.steps), **options)
        run = Run.create(folder, site.spec, agent.config, agent.seed, overwrite=True, start=agent.start)

    def in_time(report: Report) -> bool:
        return time.perf_counter() - began < share.seconds

    callbacks: list[Callback] = [keep_in(run), in_time]
    with run:
        if agent.num_timesteps < agent.config.total_timesteps:
            agent.learn(callback=callbacks, progress_bar=False)
        run.save_summary(finish(agent, run, None, None, 0))
    return agent, Spent(env_steps=agent.num_timesteps, seconds=time.perf_counter() - began)


def chained(site: Site, tree: DecisionTree, road: str, spent: Spent, smallest: int = 1) -> list[Found]:
    """The tree, and smaller and smaller parts of it, down to ``smallest`` nodes; ``spent`` is what it cost."""
    arena, began = make_arena(site.spec, site.seed), time.perf_counter()
    smaller = chain(tree, arena, smallest=smallest, observations=site.spec.all_observations())
    cost = replace(
        spent,
        env_steps=spent.env_steps + arena.steps,
        seconds=spent.seconds + time.perf_counter() - began,
    )
    return [Found(one.tree, f"{road} + shrink" if i else road, cost) for i, one in enumerate(smaller)]


def part(share: Budget, part: float) -> Budget:
    """So much of a budget."""
    return Budget(share.steps * part, share.seconds * part)
