"""The search for a front: one method after the other, then the selection and the test.

Everything is saved in one folder. What is finished is not done again, so a search that was killed resumes and loses at
most a little work of its running tasks: a training resumes from its checkpoint, evolution from its last epoch.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from ... import files
from ...bounded import parse_json
from ...envs.registry import resolve
from ...parallel import Task, run_tasks
from ...provenance import commit, versions
from ...results.records import from_fields, to_fields
from ...runs.lock import exclusive
from ...runs.metadata import RunError
from ..budget import Budget, Cost
from .config import SELECTION, SearchConfig
from .files import FILE as FRONT
from .files import load_front, save_front
from .front import Front
from .messages import Candidate, TaskResult, load_candidates, task_folder
from .methods import tasks
from .selection import select_front, test_points

CONFIG = "plan.json"
"""The file of a search's configuration."""
LIBRARIES = {"pycma": "cma"}
"""Libraries that fine-tuning needs, and their modules."""
Watch: TypeAlias = Callable[[str, float], object]
"""Called with the name of the phase that begins, and the seconds of the search so far."""


def search(config: SearchConfig, folder: Path, *, workers: int = 1, watch: Watch | None = None) -> Front:
    """Search for a front, or resume a search that was interrupted.

    Args:
        config: The configuration of the search.
        folder: Its folder, in which the front is saved, too.
        workers: The number of processes; 1 does everything in this process.
        watch: Called when a phase begins.

    Returns:
        The front. With a budget in steps the same configuration gives the same front on the same machine.

    Raises:
        RunError: The folder holds something else, or another search; or a method lacks a library.
        ValueError: The budget was too small to find a tree.
        TasksFailed: A task failed; the others are finished and saved.
        Busy: Another search works in the folder.
    """
    begin(config, folder)
    if (folder / FRONT).exists():
        return load_front(folder)
    with exclusive(folder, "search", "--out"):
        return _search(config, folder, workers, watch)


def _search(config: SearchConfig, folder: Path, workers: int, watch: Watch | None) -> Front:
    spec = resolve(config.env, env_kwargs=config.env_kwargs)
    before = _seconds_before(config, folder, workers)
    began = time.perf_counter() - sum(before.values())

    def enter(phase: str) -> float:
        elapsed = time.perf_counter() - began
        if watch is not None:
            watch(phase, elapsed)
        return elapsed

    for method in config.methods:
        budget = budget_of(config, method, enter(method) - before[method])
        todo = tasks(config, folder, method, budget, workers)
        run_tasks(todo, workers=workers, on_done=_warn, progress=False)
    candidates, cost = collect(config, folder)
    if not candidates:
        raise ValueError(
            f"a budget of {config.budget} was too small to find a tree of at most {config.max_nodes} nodes; give "
            "more, such as --budget 5m"
        )
    enter("select")
    front = select_front(config, spec, candidates, cost)
    seconds = enter("test")
    front = replace(
        test_points(front, spec, config.eval_episodes),
        cost=replace(front.cost, seconds=seconds),
        commit=commit(),
        versions=versions(),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    save_front(front, folder, spec)
    return front


def begin(config: SearchConfig, folder: Path) -> None:
    """Make the folder of a search, or check that it holds this one.

    Args:
        config: The configuration of the search.
        folder: Its folder.

    Raises:
        RunError: The folder holds something else, or another search; or a method lacks a library.
    """
    missing = [name for name, module in LIBRARIES.items() if find_spec(module) is None]
    if "teacher" in config.methods and missing:
        raise RunError(
            f"the method teacher needs {' and '.join(missing)}, not installed here: pip install 'sympol[bench]', or "
            "leave it out: --methods scratch evolve"
        )
    file, settings = folder / CONFIG, to_fields(config)
    if file.exists():
        try:
            saved = from_fields(SearchConfig, parse_json(files.read_text(file), "it"))
        except (OSError, ValueError, TypeError) as error:
            raise RunError(f"{file} cannot be read ({error}); choose another --out") from error
        changed = [
            f"{name} {value!r}, not {settings[name]!r}"
            for name, value in to_fields(saved).items()
            if value != settings[name]
        ]
        if changed:
            raise RunError(
                f"{folder} holds a search with {', '.join(changed)}; replace it with --overwrite, or choose another "
                "--out"
            )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise RunError(f"{folder} exists and is no search; choose another --out")
    folder.mkdir(parents=True, exist_ok=True)
    files.write(file, (json.dumps(settings, indent=1) + "\n"))


def collect(config: SearchConfig, folder: Path) -> tuple[list[Candidate], Cost]:
    """Read the candidates of all methods.

    Args:
        config: The configuration of the search.
        folder: Its folder.

    Returns:
        The candidates so far, and the cost of all methods together. Evolution starts from the candidates of the
        others, so the cost of these is part of the cost of its own.
    """
    candidates: list[Candidate] = []
    total = Cost()
    for method in config.methods:
        before = total if method == "evolve" else Cost()
        for saved in _candidates_by_task(config, folder, method):
            candidates += [replace(one, cost=before + one.cost) for one in saved]
            total += max((one.cost for one in saved), key=lambda one: one.env_steps, default=Cost())
    return candidates, total


def _candidates_by_task(config: SearchConfig, folder: Path, method: str) -> list[Sequence[Candidate]]:
    folders = (task_folder(folder, method, index) for index in range(config.number(method)))
    return [load_candidates(one).candidates for one in folders]


def _warn(task: Task, result: dict[str, Any]) -> None:
    """Repeat the warnings of a task in this process."""
    for message in from_fields(TaskResult, result).warnings:
        warnings.warn(f"{task.name}: {message}", stacklevel=2)


def _seconds_before(config: SearchConfig, folder: Path, workers: int) -> dict[str, float]:
    """Return the seconds of each method before the interruption, with ``workers`` tasks side by side."""

    def seconds(method: str) -> float:
        by_task = _candidates_by_task(config, folder, method)
        took = [max((one.cost.seconds for one in saved), default=0.0) for saved in by_task]
        return max(*took, sum(took) / workers)

    return {method: seconds(method) for method in config.methods}


def budget_of(config: SearchConfig, method: str, elapsed: float) -> Budget:
    """Return the budget of a method.

    Args:
        config: The configuration of the search.
        method: One of its methods.
        elapsed: The seconds that the methods before it took.

    Returns:
        Its part of the budget; for the last method, all the seconds that are left.
    """
    share = config.share(method)
    if method == config.methods[-1]:
        return Budget(config.steps * share, max(1.0, config.seconds * (1 - SELECTION) - elapsed))
    return Budget(config.steps * share, config.seconds * share)
