"""The functions that workers run: train an agent or make a tree, play, and write the result."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import jax

from .. import files
from ..agents import Agent, Report
from ..algorithms.metrics import metrics_of, require_finite
from ..algorithms.work import stops
from ..compilation import use_disk_cache
from ..distill import distill
from ..guided import trainer_of
from ..parallel.task import import_function
from ..play import Episodes, Purpose, play
from ..provenance import versions
from ..results.json_io import plain
from ..runs.lock import one_at_a_time
from ..runs.metadata import RunError
from ..runs.run import Run
from ..teachers import discretize_agent, teacher_of
from ..training import finish, has_run, resume_agent, save_into, training_seconds
from ..trees import DecisionTree
from .methods import agent_for, config_of, distill_options, environment, registered
from .plan import RESULT, Result, Unit, units_of

EPISODES = 1_000_000
"""Added to the seed of a training, this is the seed of its episodes. Each training has episodes of its own, so that
trainings stay independent, and all methods have the same ones. Distillation selects with seeds below this one."""


def run_unit(**arguments: Any) -> list[Result]:
    """Run a unit, or read its result if it is finished.

    Args:
        **arguments: Those of `units_of`.

    Returns:
        A list of its one result.
    """
    (unit,) = units_of(**arguments)
    with one_at_a_time(unit.folder):
        result = unit.result()
        return [_run(unit) if result is None else result]


def run_together(**arguments: Any) -> list[Result]:
    """Train some methods with one seed in turns. If one lacks a result, all are trained, because they are compared.

    Args:
        **arguments: Those of `units_of`.

    Returns:
        The result of each unit.
    """
    units = units_of(**arguments)
    with contextlib.ExitStack() as locks:
        for unit in sorted(units, key=lambda unit: unit.folder):
            locks.enter_context(one_at_a_time(unit.folder))
        found = [result for unit in units if (result := unit.result()) is not None]
        if len(found) == len(units):
            return found
        agents = [agent_for(unit.cell, unit.seed, unit.settings.total_timesteps) for unit in units]
        runs = [create_run(unit, agent) for unit, agent in zip(units, agents, strict=True)]
        for run in runs:
            locks.enter_context(run)
        take_turns(agents, runs)
        return [
            save_result(unit, evaluate_agent(unit, agent, run))
            for unit, agent, run in zip(units, agents, runs, strict=True)
        ]


def take_turns(agents: Sequence[Agent], runs: Sequence[Run]) -> None:
    """Train new agents to the end, alternating after each segment, so that other load on the machine slows all alike.

    An agent's clock runs only while it is trained and validated, not while anything is compiled or written.

    Args:
        agents: The agents, not yet trained.
        runs: Their runs, which get checkpoints and metrics.
    """
    use_disk_cache()
    trainers = [trainer_of(agent.spec, agent.config, agent.seed, agent.start) for agent in agents]
    try:
        for agent, trainer in zip(agents, trainers, strict=True):
            agent.compile_seconds = trainer.compile()
            jax.block_until_ready(trainer.advance(None, 1))  # compiles the host's part, too, and warms caches
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
                _save_state(agent, runs[i], elapsed[i])
    finally:
        for trainer in trainers:
            trainer.close()


def _save_state(agent: Agent, run: Run, elapsed: float) -> None:
    assert agent.state is not None
    metrics = metrics_of(agent.state, elapsed, agent.num_timesteps / elapsed)
    save_into(run)(Report(agent, agent.num_timesteps, agent.config.total_timesteps, metrics))


def _run(unit: Unit) -> Result:
    if unit.teacher is not None:
        return save_result(unit, _distill(unit, unit.teacher))
    if registered(unit.cell.method) is not None:
        return save_result(unit, _make(unit))
    agent, run = train_agent(unit)
    with run:
        return save_result(unit, evaluate_agent(unit, agent, run))


def save_result(unit: Unit, result: Result) -> Result:
    """Write a unit's result together with its config, seed and versions, and return all of that."""
    result = plain(
        {
            "seed": unit.seed,
            "config": config_of(unit.cell, unit.settings),
            **result,
            "backend": environment(unit.cell.environment).backend,
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
            "versions": versions(),
        }
    )
    unit.folder.mkdir(parents=True, exist_ok=True)
    files.write(unit.folder / RESULT, json.dumps(result, indent=1))
    return result


def train_agent(unit: Unit) -> tuple[Agent, Run]:
    """Return a unit's trained agent and its run. A training that is in its folder is resumed or only read."""
    wanted = agent_for(unit.cell, unit.seed, unit.settings.total_timesteps)
    agent, run = _open_run(unit, wanted) or (wanted, create_run(unit, wanted))
    if agent.num_timesteps < agent.config.total_timesteps:
        agent.learn(callback=save_into(run), progress_bar=False)
    return agent, run


def _open_run(unit: Unit, wanted: Agent) -> tuple[Agent, Run] | None:
    """Return the agent and the run in a unit's folder if they are of the wanted training."""
    if not has_run(unit.folder):
        return None
    try:
        run = Run.open(unit.folder)
        same = (
            run.metadata["env"] == wanted.spec.name
            and run.seed == wanted.seed
            and run.config == wanted.config
        )
        return (resume_agent(run), run) if same else None
    except RunError:
        return None  # damaged, or of another version: begin anew


def create_run(unit: Unit, agent: Agent) -> Run:
    """Create a new run in a unit's folder, replacing any that is there."""
    (unit.folder / RESULT).unlink(missing_ok=True)
    options: dict[str, Any] = {"preset": agent.preset, "eval_episodes": unit.settings.episodes}
    return Run.create(unit.folder, agent.spec, agent.config, agent.seed, overwrite=True, **options)


def evaluate_agent(unit: Unit, agent: Agent, run: Run) -> Result:
    """Play test and validation episodes with a trained agent, and write its tree and summary into its run."""
    tree = agent.tree() if agent.has_tree else None
    test = _play(unit, tree or agent, "test")
    sampled = _play(unit, agent, "test", deterministic=False)
    summary = finish(agent, run, test, sampled, EPISODES + unit.seed)
    seconds = training_seconds(run)
    speed = {"compile_seconds": agent.compile_seconds, "training_seconds": seconds}
    run.save_summary(
        summary
        | speed
        | {
            "wall_seconds": seconds + agent.compile_seconds,
            "steps_per_second": round(agent.num_timesteps / max(seconds, 1e-9)),
        }
    )
    return {
        "returns": test.returns,
        "validation_returns": _play(unit, agent, "validation").returns,
        "sampled_returns": sampled.returns,
        "nodes": None if tree is None else tree.n_nodes,
        "curve": curve_of(run),
        "seconds": seconds,
        "compile_seconds": agent.compile_seconds,
    }


def _distill(unit: Unit, teacher: Unit) -> Result:
    """Make a tree from the teacher's agent, which is trained here if nobody has trained it."""
    with one_at_a_time(teacher.folder):
        agent, run = train_agent(teacher)
        run.close()
    began = time.perf_counter()
    options = distill_options(unit.cell.method)
    if options["method"] == "discretize":
        tree = discretize_agent(agent)
    else:
        tree = distill(teacher_of(agent), seed=unit.seed, **options).prune()
    seconds = time.perf_counter() - began
    test = _play(unit, tree, "test")
    _write_tree(unit.folder, tree.with_visits(test.observations))
    return _untrained_result(test, _play(unit, agent, "validation"), tree.n_nodes, seconds)


def _make(unit: Unit) -> Result:
    """Let a registered function make the policy."""
    where = registered(unit.cell.method)
    assert where is not None
    began = time.perf_counter()
    unit.folder.mkdir(parents=True, exist_ok=True)
    policy = import_function(where)(
        environment(unit.cell.environment),
        seed=unit.seed,
        total_timesteps=unit.settings.total_timesteps,
        folder=unit.folder,
    )
    seconds = time.perf_counter() - began
    tree = policy if isinstance(policy, DecisionTree) else None
    if tree is not None:
        _write_tree(unit.folder, tree)
    test, validation = _play(unit, policy, "test"), _play(unit, policy, "validation")
    return _untrained_result(test, validation, None if tree is None else tree.n_nodes, seconds)


def _untrained_result(test: Episodes, validation: Episodes, nodes: int | None, seconds: float) -> Result:
    return {
        "returns": test.returns,
        "validation_returns": validation.returns,
        "sampled_returns": None,
        "nodes": nodes,
        "curve": None,
        "seconds": seconds,
        "compile_seconds": 0.0,
    }


def curve_of(run: Run) -> dict[str, list[float]]:
    """Return the timesteps and the mean returns of a training's validations."""
    rows = run.metrics.read()
    return {
        "timesteps": [row["time/total_timesteps"] for row in rows],
        "returns": [row["eval/mean_reward"] for row in rows],
    }


def _play(unit: Unit, policy: Any, purpose: Purpose, *, deterministic: bool = True) -> Episodes:
    return play(
        policy,
        environment(unit.cell.environment),
        unit.settings.episodes,
        seed=EPISODES + unit.seed,
        deterministic=deterministic,
        purpose=purpose,
    )


def _write_tree(folder: Path, tree: DecisionTree) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    files.write(folder / "policy.json", tree.to_json())
    files.write(folder / "tree.txt", f"{tree.to_text()}\n")
