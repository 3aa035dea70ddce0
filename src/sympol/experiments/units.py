"""One training of one cell, from nothing to its returns: the task that `bench` gives to workers."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..agents import Agent
from ..distill import distill
from ..play import Episodes, Purpose, play
from ..runs.checkpoint import write_atomically
from ..runs.folder import Run, RunError, versions
from ..teachers import discretize_agent, teacher_of
from ..training import finish, go_on, has_run, keep_in, training_seconds
from ..trees import DecisionTree
from .plain_json import plain
from .recipes import (
    Settings,
    agent_for,
    config_of,
    distilling,
    environment,
    import_all,
    own,
    register_method,
    same_config,
    teacher_cell,
)
from .record import Cell
from .seeds import require_training_seed
from .workers import Task

EPISODES = 1_000_000
"""Added to the seed of a training, the seed of its episodes here. Each training has episodes of its own, so that
trainings stay independent, and all methods have the same ones. Distillation selects with seeds below this one."""
RESULT = "bench.json"

Result = dict[str, Any]


@dataclass(frozen=True)
class Unit:
    """One training of a cell, or one tree made of one."""

    cell: Cell
    seed: int
    settings: Settings
    runs: Path
    """The folder of all units, absolute."""

    @property
    def name(self) -> str:
        """What it is called in progress and errors."""
        return f"{self.cell.environment} {'-'.join(filter(None, self.cell[1:]))} seed {self.seed}"

    @property
    def folder(self) -> Path:
        """Of its run."""
        cell = "-".join(filter(None, self.cell[1:]))
        safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in self.cell.environment)
        return self.runs / safe / cell / f"seed-{self.seed}"

    @property
    def teacher(self) -> Unit | None:
        """The training that it makes a tree of."""
        cell = teacher_cell(self.cell)
        return None if cell is None else Unit(cell, self.seed, self.settings, self.runs)

    def task(self, modules: Sequence[str] = ()) -> Task:
        """The same for a worker."""
        arguments = {
            "cell": list(self.cell),
            "seed": self.seed,
            "settings": list(self.settings),
            "runs": str(self.runs),
            "modules": list(modules),
            "make": own(self.cell.method),
        }
        return Task(self.name, f"{__name__}:run_unit", arguments)

    def result(self) -> Result | None:
        """What came of it, if it is finished, and was made as it would be now."""
        try:
            result = json.loads((self.folder / RESULT).read_text(encoding="utf-8"))
            return result if same_config(result["config"], config_of(self.cell, self.settings)) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None  # none there, or a damaged one: it is made again


def run_unit(
    cell: Sequence[str],
    seed: int,
    settings: Sequence[int],
    runs: str,
    modules: Sequence[str] = (),
    make: str | None = None,
) -> Result:
    """Train or make, play, keep; what is finished already is only read."""
    import_all(modules)
    name = Cell(*cell)
    if make is not None:
        register_method(name.method, make)
    unit = Unit(name, require_training_seed(seed), Settings(*settings), Path(runs))
    with alone(unit.folder):
        result = unit.result()
        return finished(unit) if result is None else result


def finished(unit: Unit) -> Result:
    """Do the unit, and write its result."""
    began = time.perf_counter()
    if unit.teacher is not None:
        result = _distilled(unit, unit.teacher)
    elif own(unit.cell.method) is not None:
        result = _own(unit)
    else:
        agent, run = trained(unit)
        result = tested(unit, agent, run)
    result = {
        "seed": unit.seed,
        "config": config_of(unit.cell, unit.settings),
        **result,
        "backend": environment(unit.cell.environment).backend,
        "wall_seconds": time.perf_counter() - began,
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "versions": versions(),
    }
    unit.folder.mkdir(parents=True, exist_ok=True)
    write_atomically(unit.folder / RESULT, json.dumps(plain(result), indent=1).encode())
    return plain(result)


def trained(unit: Unit) -> tuple[Agent, Run]:
    """The agent at the end of its training, in its run's folder: read, gone on with, or begun."""
    wanted = agent_for(unit.cell, unit.seed, unit.settings.total_timesteps)
    agent, run = _left(unit, wanted) or _begun(unit, wanted)
    if agent.num_timesteps < agent.config.total_timesteps:
        agent.learn(callback=keep_in(run), progress_bar=False)
    return agent, run


def _left(unit: Unit, wanted: Agent) -> tuple[Agent, Run] | None:
    """What an earlier bench left, if it was to be the same."""
    if not has_run(unit.folder):
        return None
    try:
        run = Run.open(unit.folder)
        same = (
            run.about["env"] == wanted.spec.name and run.seed == wanted.seed and run.config == wanted.config
        )
        return (go_on(run), run) if same else None
    except RunError:
        return None  # damaged, or by another version: begin anew


def _begun(unit: Unit, agent: Agent) -> tuple[Agent, Run]:
    (unit.folder / RESULT).unlink(missing_ok=True)
    options: dict[str, Any] = {"preset": agent.preset, "eval_episodes": unit.settings.episodes}
    return agent, Run.create(unit.folder, agent.spec, agent.config, agent.seed, overwrite=True, **options)


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
    with alone(teacher.folder):
        agent, _ = trained(teacher)
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
    from .workers.task import resolve

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
    write_atomically(folder / "policy.json", tree.to_json().encode())
    write_atomically(folder / "tree.txt", f"{tree.to_text()}\n".encode())


@contextlib.contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Let nobody else on this machine work in a folder; who comes second waits."""
    import fcntl

    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.with_name(f".{folder.name}.lock"), "w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
