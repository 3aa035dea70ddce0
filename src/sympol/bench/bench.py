"""From a table to its records: what is missing is run, what is finished is kept."""

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
from .jobs import Result, Unit, jobs_of, task_of
from .method_specs import same_config
from .plan import CellPlan
from .record import Cell, Record

CHANGED = "its config is another than at the start: presets or sources changed meanwhile; run the bench again"


@dataclass
class Work:
    """What came of each cell, while it is done."""

    root: Path
    plans: Sequence[CellPlan]
    on_record: Callable[[Record, Path], None]
    results: dict[Cell, dict[int, Result]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    """What was done, but not as planned."""

    def keep(self, unit: Unit, result: Result) -> None:
        """Take a unit's result; write its cell's record if it was the last.

        A teacher that was trained for its trees alone is no part of a record.
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

    def has(self, job: Sequence[Unit]) -> bool:
        """Whether a job's results are in its folders already; takes them if so."""
        results = [unit.result() for unit in job]
        if any(result is None for result in results):
            return False
        for unit, result in zip(job, results, strict=True):
            self.keep(unit, result or {})
        return True

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
    failures: list[Failure] = []
    commit()  # now: the sources may change while they run
    with exclusive(runs, "bench", "--runs"):
        units = [unit for plan in plans for unit in plan.units]
        todo = [job for job in jobs_of(units) if not work.has(job)]
        for wave in waves(todo, workers):
            jobs = {task_of(job).name: job for job in wave}

            def keep(task: Task, results: list[Result], jobs: dict[str, list[Unit]] = jobs) -> None:
                for unit, result in zip(jobs[task.name], results, strict=True):
                    work.keep(unit, result)

            tasks = [task_of(job, modules) for job in _with_teachers(wave, failures)]
            options: dict[str, Any] = {"workers": workers, "scheduler": scheduler, "progress": progress}
            try:
                run_tasks(tasks, on_done=keep, **options)
            except TasksFailed as failed:
                failures += failed.failures
        for plan in plans:
            work.write(plan)  # of a cell of which some failed
    return [*failures, *work.failures]


def waves(jobs: Sequence[list[Unit]], workers: int = 1) -> list[list[list[Unit]]]:
    """Trainings first, those of teachers that nobody has trained included; then the trees made of them."""
    derived = [job for job in jobs if job[0].teacher is not None]
    trained = [job for job in jobs if job[0].teacher is None]
    there = {unit for job in trained for unit in job}
    teachers = dict.fromkeys(unit.teacher for job in derived for unit in job if unit.teacher is not None)
    needed = [[unit] for unit in teachers if unit not in there and unit.result() is None]
    return [interleaved(wave, workers) for wave in ([*trained, *needed], derived) if wave]


def interleaved(jobs: Iterable[list[Unit]], workers: int) -> list[list[Unit]]:
    """Jobs of as many cells as there are workers in turn.

    So that workers rarely compile the same program at the same time, and cells are finished one after another.
    """
    cells: dict[Cell, list[list[Unit]]] = {}
    for job in jobs:
        cells.setdefault(job[0].cell, []).append(job)
    queues = [*cells.values()]
    together = (zip_longest(*queues[i : i + workers]) for i in range(0, len(queues), workers))
    return [job for turns in together for turn in turns for job in turn if job is not None]


def _with_teachers(wave: Sequence[list[Unit]], failures: list[Failure]) -> list[list[Unit]]:
    """Without trees of teachers whose training failed, which fail with them."""
    failed = {failure.task.name for failure in failures}
    able = []
    for job in wave:
        if job[0].teacher is not None and job[0].teacher.name in failed:
            failures.append(Failure(task_of(job), "the training of its teacher failed", ""))
        else:
            able.append(job)
    return able


def record_of(plan: CellPlan, results: Sequence[Result]) -> Record:
    """A cell's record, from its trainings that are done now and those that it had."""
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
    """What a record says of each training."""
    if record is None:
        return {}
    columns = {name: getattr(record, name) for name in _COLUMNS}
    columns |= {name: record.extra.get(name) for name in _NOTES}
    return {
        seed: {name: None if values is None else values[i] for name, values in columns.items()}
        for i, seed in enumerate(record.seeds)
    }
