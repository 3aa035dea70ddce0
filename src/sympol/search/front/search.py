"""The search for a front: one method after the other, each saved as it runs, then the selection.

Everything is in one folder. What is finished is not done again, so a search that was killed resumes and
loses at most what its tasks were doing: a training resumes from its checkpoint, evolution from its last epoch.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TypeAlias

from ... import files
from ...bounded import parse_json
from ...envs.registry import resolve
from ...parallel import Task, run_tasks
from ...provenance import commit, versions
from ...runs.lock import exclusive
from ...runs.metadata import RunError
from ..budget import Budget
from .candidates import Candidate, load_candidates
from .config import CHOOSING, SearchConfig
from .files import FILE as FRONT
from .files import load_front, save_front
from .front import Cost, Front
from .methods import place, tasks
from .selection import select_front, test

PLAN = "plan.json"
LIBRARIES = {"scikit-learn": "sklearn", "pycma": "cma"}
"""Libraries that distillation needs, and their modules."""
Watch: TypeAlias = Callable[[str, float], object]
"""Told what is done now, and the seconds that the search has taken so far."""


def search(plan: SearchConfig, folder: Path, *, workers: int = 1, watch: Watch | None = None) -> Front:
    """Search, or resume a search that was interrupted; return the front, which is also saved in the folder.

    Raises:
        RunError: the folder holds something else, or the search of another plan; or a method lacks a library.
        ValueError: a budget that is too small to find anything.
        TasksFailed: a method that failed.
        Busy: another search works in the folder.
    """
    begin(plan, folder)
    if (folder / FRONT).exists():
        return load_front(folder)
    with exclusive(folder, "search", "--out"):
        return _search(plan, folder, workers, watch)


def _search(plan: SearchConfig, folder: Path, workers: int, watch: Watch | None) -> Front:
    spec = resolve(plan.env, env_kwargs=plan.env_kwargs)
    before = _seconds_before(plan, folder, workers)
    began = time.perf_counter() - sum(before.values())

    def now(doing: str) -> float:
        elapsed = time.perf_counter() - began
        if watch is not None:
            watch(doing, elapsed)
        return elapsed

    for road in plan.methods:
        todo = tasks(plan, folder, road, _share(plan, road, now(road) - before[road]), workers)
        run_tasks(todo, workers=workers, on_done=_warn, progress=False)
    found, spent = collected(plan, folder)
    if not found:
        raise ValueError(
            f"a budget of {plan.budget} was too small to find a tree of at most {plan.max_nodes} nodes; give more, "
            "such as --budget 5m"
        )
    now("choose")
    front = select_front(plan, spec, found, spent)
    seconds = now("test")
    front = replace(
        test(front, spec, plan.eval_episodes),
        cost=replace(front.cost, seconds=seconds),
        commit=commit(),
        versions=versions(),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    save_front(front, folder, spec)
    return front


def begin(plan: SearchConfig, folder: Path) -> None:
    """Make the folder of a search, or see that it holds this one.

    Raises:
        RunError: it does not, or a method lacks a library.
    """
    missing = [name for name, module in LIBRARIES.items() if find_spec(module) is None]
    if "teacher" in plan.methods and missing:
        raise RunError(
            f"the teacher's road needs {' and '.join(missing)}, not installed here: pip install 'sympol[bench]', or "
            "leave it out: --methods scratch evolve"
        )
    file = folder / PLAN
    if file.exists():
        try:
            was = SearchConfig.from_dict(parse_json(files.read_text(file), "it"))
        except (OSError, ValueError, TypeError) as error:
            raise RunError(f"{file} cannot be read ({error}); choose another --out") from error
        changed = [
            f"{name} {value!r}, not {plan.to_dict()[name]!r}"
            for name, value in was.to_dict().items()
            if value != plan.to_dict()[name]
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
    files.write(file, (json.dumps(plan.to_dict(), indent=1) + "\n"))


def collected(plan: SearchConfig, folder: Path) -> tuple[list[Candidate], Cost]:
    """Return all candidates of all methods so far, and their cost together.

    Evolution starts from what the others found, so what it found has cost what they did, too.
    """
    found: list[Candidate] = []
    spent = Cost()
    for road in plan.methods:
        before = spent if road == "evolve" else Cost()
        for task in tasks(plan, folder, road, Budget()):
            trees, _ = load_candidates(place(folder, road, task.arguments["index"]))
            found += [replace(one, cost=before + one.cost) for one in trees]
            spent += max((one.cost for one in trees), key=lambda one: one.env_steps, default=Cost())
    return found, spent


def _warn(task: Task, messages: list[str]) -> None:
    """Say here what was warned of in a worker."""
    for message in messages:
        warnings.warn(f"{task.name}: {message}", stacklevel=2)


def _seconds_before(plan: SearchConfig, folder: Path, workers: int) -> dict[str, float]:
    """Return the seconds of each method before the interruption, with ``workers`` tasks side by side."""

    def seconds(road: str) -> float:
        took = [
            max(
                (
                    one.cost.seconds
                    for one in load_candidates(place(folder, road, task.arguments["index"]))[0]
                ),
                default=0.0,
            )
            for task in tasks(plan, folder, road, Budget())
        ]
        return max(*took, sum(took) / workers)

    return {road: seconds(road) for road in plan.methods}


def _share(plan: SearchConfig, road: str, elapsed: float) -> Budget:
    """Return the budget of a method: its part; for the last one, all that is left after ``elapsed`` seconds."""
    if road == plan.methods[-1]:
        return Budget(plan.steps * plan.share(road), max(1.0, plan.seconds * (1 - CHOOSING) - elapsed))
    return Budget(plan.steps * plan.share(road), plan.seconds * plan.share(road))
