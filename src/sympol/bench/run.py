"""Run what cells lack, and write the record of each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path
from typing import Any

from ..parallel import Failure, Task, TasksFailed, run_tasks
from ..provenance import commit
from ..runs.lock import exclusive
from .methods import same_config
from .plan import CellPlan, Result, Unit, jobs_of, task_of
from .record import Cell, Record

CHANGED = "presets or sources changed during the run, and with them its config; run the bench again"


@dataclass
class Results:
    """The results of units so far, which become the records of their cells."""

    root: Path
    plans: Sequence[CellPlan]
    on_record: Callable[[Record, Path], None]
    results: dict[Cell, dict[int, Result]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    """Units that finished with another config than planned."""

    def add(self, unit: Unit, result: Result) -> None:
        """Add a unit's result, and write its cell's record if it was the last one.

        The result of a teacher that is trained only for its trees is in no plan and is ignored.
        """
        for plan in self.plans:
            if unit not in plan.units:
                continue
            if same_config(result["config"], plan.config):
                done = self.results.setdefault(unit.cell, {})
                done[unit.seed] = result
                if all(unit.seed in done for unit in plan.units):
                    self.write(plan)
            else:
                self.failures.append(Failure(task_of([unit]), CHANGED, ""))

    def add_finished(self, job: Sequence[Unit]) -> bool:
        """Add the results that all units of a job have in their folders, if they do, and return whether they do."""
        results = [unit.result() for unit in job]
        if any(result is None for result in results):
            return False
        for unit, result in zip(job, results, strict=True):
            self.add(unit, result or {})
        return True

    def write(self, plan: CellPlan) -> None:
        """Write the record of the results that a cell has, if it has any."""
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
    """Run what cells lack, and write the record of each as soon as it is complete.

    A cell some of whose trainings failed gets a record of the others.

    Args:
        plans: The cells.
        root: The folder of records.
        runs: The folder of all runs.
        workers: Processes on this machine.
        scheduler: The address of a Dask scheduler, in place of ``workers``.
        modules: Modules that register environments or methods; workers import them.
        progress: Whether to draw a line of progress.
        on_record: Called with each record and its path.

    Returns:
        The tasks that failed.

    Raises:
        Busy: Another bench works in ``runs``.
        SchedulerError, ValueError, ImportError: See `run_tasks`.
    """
    results = Results(root, plans, on_record)
    failures: list[Failure] = []
    commit()  # now, because the sources may change while tasks run
    with exclusive(runs, "bench", "--runs"):
        units = [unit for plan in plans for unit in plan.units]
        todo = [job for job in jobs_of(units) if not results.add_finished(job)]
        for wave in waves(todo, workers):
            jobs = {task_of(job).name: job for job in wave}

            def add(task: Task, answers: list[Result], jobs: dict[str, list[Unit]] = jobs) -> None:
                for unit, result in zip(jobs[task.name], answers, strict=True):
                    results.add(unit, result)

            tasks = [task_of(job, modules) for job in _with_teachers(wave, failures)]
            options: dict[str, Any] = {"workers": workers, "scheduler": scheduler, "progress": progress}
            try:
                run_tasks(tasks, on_done=add, **options)
            except TasksFailed as failed:
                failures += failed.failures
        for plan in plans:
            results.write(plan)  # those of which some trainings failed
    return [*failures, *results.failures]


def waves(jobs: Sequence[list[Unit]], workers: int = 1) -> list[list[list[Unit]]]:
    """Order jobs in two waves: trainings, missing teachers included, and then the trees made from them.

    Args:
        jobs: The jobs.
        workers: The number of workers, see `interleaved`.

    Returns:
        The waves that have jobs.
    """
    derived = [job for job in jobs if job[0].teacher is not None]
    trained = [job for job in jobs if job[0].teacher is None]
    there = {unit for job in trained for unit in job}
    teachers = dict.fromkeys(unit.teacher for job in derived for unit in job if unit.teacher is not None)
    needed = [[unit] for unit in teachers if unit not in there and unit.result() is None]
    return [interleaved(wave, workers) for wave in ([*trained, *needed], derived) if wave]


def interleaved(jobs: Iterable[list[Unit]], workers: int) -> list[list[Unit]]:
    """Order jobs so that those of as many cells as there are workers alternate.

    Workers then rarely compile the same program at the same time, and cells are finished one after another.
    """
    cells: dict[Cell, list[list[Unit]]] = {}
    for job in jobs:
        cells.setdefault(job[0].cell, []).append(job)
    queues = [*cells.values()]
    together = (zip_longest(*queues[i : i + workers]) for i in range(0, len(queues), workers))
    return [job for turns in together for turn in turns for job in turn if job is not None]


def _with_teachers(wave: Sequence[list[Unit]], failures: list[Failure]) -> list[list[Unit]]:
    """Return the jobs whose teachers were trained; the others are added to the failures."""
    failed = {failure.task.name for failure in failures}
    able = []
    for job in wave:
        if job[0].teacher is not None and job[0].teacher.name in failed:
            failures.append(Failure(task_of(job), "the training of its teacher failed", ""))
        else:
            able.append(job)
    return able


def record_of(plan: CellPlan, results: Sequence[Result]) -> Record:
    """Return a cell's record, from new results and the trainings that it already had.

    Args:
        plan: The cell.
        results: The results of its units, at least one.
    """
    rows = _rows(plan.record) | {result["seed"]: _row(result) for result in results}
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
_NOTES = ("compile_seconds", "load", "backend")


def _row(result: Result) -> dict[str, Any]:
    return {**result, "curves": result["curve"]}


def _rows(record: Record | None) -> dict[int, dict[str, Any]]:
    """Return the columns of a record by training."""
    if record is None:
        return {}
    columns = {name: getattr(record, name) for name in _COLUMNS}
    columns |= {name: record.extra.get(name) for name in _NOTES}
    return {
        seed: {name: None if values is None else values[i] for name, values in columns.items()}
        for i, seed in enumerate(record.seeds)
    }
