"""From a table to its records: what is missing is run, what is finished is kept."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path
from typing import Any

from .plan import CellPlan
from .record import Cell, Record
from .units import Result, Unit
from .workers import Failure, Task, TasksFailed, run_tasks

LOCK = ".bench.lock"


class Busy(OSError):
    """Another bench works in the same folder."""


@dataclass
class Work:
    """What came of each cell, while it is done."""

    root: Path
    plans: Sequence[CellPlan]
    on_record: Callable[[Record, Path], None]
    results: dict[Cell, dict[int, Result]] = field(default_factory=dict)

    def keep(self, unit: Unit, result: Result) -> None:
        """Take a unit's result; write its cell's record if it was the last."""
        done = self.results.setdefault(unit.cell, {})
        done[unit.seed] = result
        plan = next((plan for plan in self.plans if plan.cell == unit.cell), None)
        if plan is not None and all(unit.seed in done for unit in plan.units):
            self.write(plan)

    def write(self, plan: CellPlan) -> None:
        """Write what there is of a cell, if anything."""
        if done := self.results.pop(plan.cell, None):
            record = record_of(plan, [done[seed] for seed in sorted(done)])
            self.on_record(record, record.save(self.root))


def run(
    plans: Sequence[CellPlan],
    *,
    root: Path,
    runs: Path,
    workers: int = 1,
    scheduler: str | None = None,
    modules: Sequence[str] = (),
    progress: bool = True,
    on_record: Callable[[Record, Path], None] = lambda record, path: None,
) -> list[Failure]:
    """Run what cells lack, and write a record of each as soon as it is complete.

    What failed is returned when all else is done; a cell of which some trainings failed has a record of the others.

    Raises:
        Busy: another bench works in ``runs``.
        SchedulerError, ValueError, ImportError: see `run_tasks`.
    """
    work = Work(root, plans, on_record)
    with only_one(runs):
        todo = _not_finished([unit for plan in interleaved(plans, workers) for unit in plan], work)
        failures: list[Failure] = []
        for wave in waves(todo):
            failed = {failure.task.name for failure in failures}
            lost = [unit for unit in wave if unit.teacher is not None and unit.teacher.name in failed]
            failures += [Failure(unit.task(), "its teacher's training failed", "") for unit in lost]
            units = {unit.name: unit for unit in wave if unit not in lost}

            def keep(task: Task, result: Result, units: dict[str, Unit] = units) -> None:
                work.keep(units[task.name], result)

            try:
                run_tasks(
                    [unit.task(modules) for unit in units.values()],
                    workers=workers,
                    scheduler=scheduler,
                    on_done=keep,
                    progress=progress,
                )
            except TasksFailed as failed_tasks:
                failures += failed_tasks.failures
        for plan in plans:
            work.write(plan)  # of a cell of which some failed
    return failures


def _not_finished(units: Sequence[Unit], work: Work) -> list[Unit]:
    """Units whose results are not in their folders yet."""
    found = {unit: unit.result() for unit in units}
    for unit, result in found.items():
        if result is not None:
            work.keep(unit, result)
    return [unit for unit in units if found[unit] is None]


def waves(units: Sequence[Unit]) -> list[list[Unit]]:
    """Trainings first, those of teachers that nobody has trained included; then the trees made of them."""
    derived = [unit for unit in units if unit.teacher is not None]
    teachers = [unit.teacher for unit in derived if unit.teacher is not None]
    needed = [teacher for teacher in teachers if teacher.result() is None]
    trained = [unit for unit in units if unit.teacher is None]
    return [wave for wave in ([*dict.fromkeys([*trained, *needed])], derived) if wave]


def interleaved(plans: Sequence[CellPlan], workers: int) -> Iterator[list[Unit]]:
    """Units of as many cells as there are workers in turn.

    So that each worker stays with a cell, whose program it has compiled, and cells are finished one after another.
    """
    todo = [plan for plan in plans if plan.units]
    todo.sort(key=lambda plan: plan.units[0].teacher is not None)
    for i in range(0, len(todo), workers):
        for together in zip_longest(*(plan.units for plan in todo[i : i + workers])):
            yield [unit for unit in together if unit is not None]


def record_of(plan: CellPlan, results: Sequence[Result]) -> Record:
    """A cell's record, from its trainings that are done now and those that it had."""
    rows = {result["seed"]: _row(result) for result in results} | _rows(plan.record)
    seeds = sorted(rows)

    def column(name: str) -> Any:
        values = [rows[seed][name] for seed in seeds]
        return None if any(value is None for value in values) else values

    return Record(
        environment=plan.cell.environment,
        algo=plan.cell.algo,  # pyright: ignore[reportArgumentType]
        method=plan.cell.method,
        variant=plan.cell.variant,
        total_timesteps=plan.config["training"]["total_timesteps"],
        seeds=tuple(seeds),
        **{name: column(name) for name in _COLUMNS},
        config=dict(plan.config),
        versions=results[-1]["versions"],
        commit=commit(),
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        extra={name: [rows[seed][name] for seed in seeds] for name in _NOTES},
    )


_COLUMNS = ("returns", "validation_returns", "sampled_returns", "nodes", "curves", "seconds")
_NOTES = ("compile_seconds", "wall_seconds", "load", "backend")


def _row(result: Result) -> dict[str, Any]:
    return {**result, "curves": result["curve"]}


def _rows(record: Record | None) -> dict[int, dict[str, Any]]:
    """What a record says of each training."""
    if record is None:
        return {}
    columns = {name: getattr(record, name) for name in _COLUMNS}
    columns |= {name: record.extra.get(name) for name in _NOTES}
    return {
        seed: {name: None if values is None else values[i] for name, values in columns.items()}
        for i, seed in enumerate(record.seeds)
    }


def commit() -> str:
    """Of the sources that run, "+" behind it where they differ from it; nothing where they are not in git."""
    here = Path(__file__).parent

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=here, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    with contextlib.suppress(OSError):
        changed = git("status", "--porcelain", "--untracked-files=no", str(here.parent))
        return f"{git('rev-parse', 'HEAD')}{'+' if changed else ''}"
    return ""


@contextlib.contextmanager
def only_one(runs: Path) -> Iterator[None]:
    """Let nobody else bench into the folder meanwhile.

    Raises:
        Busy: somebody does.
    """
    import fcntl

    runs.mkdir(parents=True, exist_ok=True)
    with open(runs / LOCK, "a+") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = file.read().strip() or "somebody"
            raise Busy(
                f"another bench works in {runs}: {holder}; wait for it, or choose another --runs"
            ) from None
        file.truncate(0)
        file.write(f"process {os.getpid()} on {socket.gethostname()}")
        file.flush()
        yield
