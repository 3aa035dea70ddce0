"""Trainings that take turns, segment by segment: whatever else the machine does, it does to all of them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

import jax

from ..agents import Agent, Report
from ..algorithms.metrics import metrics_of, require_finite
from ..algorithms.trainer import make_trainer, stops
from ..compilation import use_disk_cache
from ..runs.lock import one_at_a_time
from ..runs.run import Run
from ..training import save_into
from .jobs import Result, units_of
from .method_specs import agent_for
from .run import begun, kept, tested


def run_together(**arguments: Any) -> list[Result]:
    """Train some methods with one seed in turns (`task_of`). If one is to be done, all are: they are compared."""
    units = units_of(**arguments)
    with contextlib.ExitStack() as locks:
        for unit in sorted(units, key=lambda unit: unit.folder):
            locks.enter_context(one_at_a_time(unit.folder))
        found = [result for unit in units if (result := unit.result()) is not None]
        if len(found) == len(units):
            return found
        agents = [agent_for(unit.cell, unit.seed, unit.settings.total_timesteps) for unit in units]
        runs = [begun(unit, agent) for unit, agent in zip(units, agents, strict=True)]
        for run in runs:
            locks.enter_context(run)
        take_turns(agents, runs)
        return [
            kept(unit, tested(unit, agent, run)) for unit, agent, run in zip(units, agents, runs, strict=True)
        ]


def take_turns(agents: Sequence[Agent], runs: Sequence[Run]) -> None:
    """Train new agents to the end, each in its run's folder, a segment of one after a segment of another.

    The clock of each runs only while it is trained and validated: not while anything is compiled or written.
    """
    use_disk_cache()
    trainers = [make_trainer(agent.spec, agent.config, agent.seed) for agent in agents]
    try:
        for agent, trainer in zip(agents, trainers, strict=True):
            agent.compile_seconds = trainer.compile()
            jax.block_until_ready(trainer.advance(None, 1))  # what the host compiles besides, and warm caches
        elapsed = [0.0 for _ in agents]
        for turn in zip_longest(*(stops(agent.config) for agent in agents)):
            for i, (agent, stop) in enumerate(zip(agents, turn, strict=True)):
                if stop is None or stop <= agent.num_timesteps:
                    continue
                began = time.perf_counter()
                state = jax.block_until_ready(trainers[i].advance(agent.state, stop))
                elapsed[i] += time.perf_counter() - began
                require_finite(state, agent.num_timesteps, agent.spec.features.names)
                agent.state = state
                _keep(agent, runs[i], elapsed[i])
    finally:
        for trainer in trainers:
            trainer.close()


def _keep(agent: Agent, run: Run, elapsed: float) -> None:
    assert agent.state is not None
    metrics = metrics_of(agent.state, elapsed, agent.num_timesteps / elapsed)
    save_into(run)(Report(agent, agent.num_timesteps, agent.config.total_timesteps, metrics))
