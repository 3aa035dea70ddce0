"""From nothing to a training's returns: trained, or made of what was trained, then played and kept."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any

from .. import files
from ..agents import Agent
from ..distill import distill
from ..parallel.task import resolve
from ..play import Episodes, Purpose, play
from ..provenance import versions
from ..results.json_io import plain
from ..runs.lock import one_at_a_time
from ..runs.metadata import RunError
from ..runs.run import Run
from ..teachers import discretize_agent, teacher_of
from ..training import finish, has_run, resume_agent, save_into, training_seconds
from ..trees import DecisionTree
from .jobs import RESULT, Result, Unit, units_of
from .method_specs import agent_for, config_of, distilling, environment, own

EPISODES = 1_000_000
"""Added to the seed of a training, the seed of its episodes here. Each training has episodes of its own, so that
trainings stay independent, and all methods have the same ones. Distillation selects with seeds below this one."""


def run_unit(**arguments: Any) -> list[Result]:
    """Train or make, play, keep (`task_of`); what is finished already is only read."""
    (unit,) = units_of(**arguments)
    with one_at_a_time(unit.folder):
        result = unit.result()
        return [_run(unit) if result is None else result]


def _run(unit: Unit) -> Result:
    if unit.teacher is not None:
        return kept(unit, _distilled(unit, unit.teacher))
    if own(unit.cell.method) is not None:
        return kept(unit, _own(unit))
    agent, run = trained(unit)
    with run:
        return kept(unit, tested(unit, agent, run))


def kept(unit: Unit, result: Result) -> Result:
    """Write a result with what it was made with and by."""
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


def trained(unit: Unit) -> tuple[Agent, Run]:
    """The agent at the end of its training, in its run's folder: read, gone on with, or begun."""
    wanted = agent_for(unit.cell, unit.seed, unit.settings.total_timesteps)
    agent, run = _left(unit, wanted) or (wanted, begun(unit, wanted))
    if agent.num_timesteps < agent.config.total_timesteps:
        agent.learn(callback=save_into(run), progress_bar=False)
    return agent, run


def _left(unit: Unit, wanted: Agent) -> tuple[Agent, Run] | None:
    """What an earlier bench left, if it was to be the same."""
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
        return None  # damaged, or by another version: begin anew


def begun(unit: Unit, agent: Agent) -> Run:
    """A new run in the unit's folder, whatever was there."""
    (unit.folder / RESULT).unlink(missing_ok=True)
    options: dict[str, Any] = {"preset": agent.preset, "eval_episodes": unit.settings.episodes}
    return Run.create(unit.folder, agent.spec, agent.config, agent.seed, overwrite=True, **options)


def tested(unit: Unit, agent: Agent, run: Run) -> Result:
    """Play with a trained agent, write its tree and its summary."""
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


def _distilled(unit: Unit, teacher: Unit) -> Result:
    """Make a tree of the teacher's agent, which is trained here if nobody has."""
    with one_at_a_time(teacher.folder):
        agent, run = trained(teacher)
        run.close()
    began = time.perf_counter()
    options = distilling(unit.cell.method)
    if options["method"] == "discretize":
        tree = discretize_agent(agent)
    else:
        tree = distill(teacher_of(agent), seed=unit.seed, **options).prune()
    seconds = time.perf_counter() - began
    test = _play(unit, tree, "test")
    _write_tree(unit.folder, tree.with_visits(test.observations))
    return {
        "returns": test.returns,
        "validation_returns": _play(unit, agent, "validation").returns,
        "sampled_returns": None,
        "nodes": tree.n_nodes,
        "curve": None,
        "seconds": seconds,
        "compile_seconds": 0.0,
    }


def _own(unit: Unit) -> Result:
    """Let a function of the user's make the policy."""
    where = own(unit.cell.method)
    assert where is not None
    began = time.perf_counter()
    unit.folder.mkdir(parents=True, exist_ok=True)
    policy = resolve(where)(
        environment(unit.cell.environment),
        seed=unit.seed,
        total_timesteps=unit.settings.total_timesteps,
        folder=unit.folder,
    )
    seconds = time.perf_counter() - began
    if isinstance(policy, DecisionTree):
        _write_tree(unit.folder, policy)
    return {
        "returns": _play(unit, policy, "test").returns,
        "validation_returns": _play(unit, policy, "validation").returns,
        "sampled_returns": None,
        "nodes": policy.n_nodes if isinstance(policy, DecisionTree) else None,
        "curve": None,
        "seconds": seconds,
        "compile_seconds": 0.0,
    }


def curve_of(run: Run) -> dict[str, list[float]]:
    """Each validation of a training."""
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
