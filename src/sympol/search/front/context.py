"""The context of a task: its folder, its part of the budget, training and pruning."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...agents import PPO, Agent, Callback, Report
from ...envs.spec import EnvSpec
from ...runs.run import Run
from ...seeds import SeedStream
from ...training import finish, has_run, resume_agent, save_into
from ...trees import DecisionTree
from ..budget import Budget
from ..evaluators import make_evaluator
from ..prune_by_return import prune_path
from .candidates import Candidate
from .config import SearchConfig
from .front import Cost

TRAINING = 0.5
"""The part of a share, at most, for the training that a method begins with."""


@dataclass(frozen=True)
class TaskContext:
    """The plan, the environment, the folder and the budget of one task."""

    plan: SearchConfig
    spec: EnvSpec
    root: Path
    """The search's folder."""
    index: int
    folder: Path
    """This task's."""
    share: Budget

    @property
    def seed(self) -> int:
        """The seed of everything random in this task."""
        return self.stream.seed()

    @property
    def stream(self) -> SeedStream:
        """The stream of seeds of this task."""
        return SeedStream(self.plan.seed, self.index, self.folder.parent.name)


def train_policy(
    context: TaskContext, policy: str, folder: Path, share: Budget, **options: Any
) -> tuple[Agent, Cost]:
    """Train in a run's folder, or resume there, until the end or until the share is spent."""
    began = time.perf_counter()
    if has_run(folder):
        run = Run.open(folder)
        agent = resume_agent(run)
    else:
        agent = PPO(policy, context.spec, seed=context.seed, **options)
        if share.steps < agent.config.total_timesteps:
            agent = PPO(policy, context.spec, seed=context.seed, total_timesteps=int(share.steps), **options)
        run = Run.create(folder, context.spec, agent.config, agent.seed, overwrite=True, start=agent.start)

    def in_time(report: Report) -> bool:
        return time.perf_counter() - began < share.seconds

    callbacks: list[Callback] = [save_into(run), in_time]
    with run:
        if agent.num_timesteps < agent.config.total_timesteps:
            agent.learn(callback=callbacks, progress_bar=False)
        run.save_summary(finish(agent, run, None, None, 0))
    return agent, Cost(env_steps=agent.num_timesteps, seconds=time.perf_counter() - began)


def prune_candidates(
    context: TaskContext, tree: DecisionTree, road: str, spent: Cost, smallest: int = 1
) -> list[Candidate]:
    """Return the tree and ever smaller prunings of it, down to ``smallest`` nodes; ``spent`` is its cost."""
    evaluator, began = make_evaluator(context.spec, context.seed), time.perf_counter()
    smaller = prune_path(tree, evaluator, smallest=smallest, observations=context.spec.all_observations())
    cost = replace(
        spent,
        env_steps=spent.env_steps + evaluator.steps,
        seconds=spent.seconds + time.perf_counter() - began,
    )
    return [Candidate(one.tree, f"{road} + shrink" if i else road, cost) for i, one in enumerate(smaller)]


def scale_budget(share: Budget, part: float) -> Budget:
    """Return a part of a budget."""
    return Budget(share.steps * part, share.seconds * part)
