"""The work of the bench: the cells that are selected, the trainings that each lacks, and their tasks for workers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

from .. import files
from ..bounded import parse_json
from ..parallel import Task
from ..results.seeds import require_training_seed
from ..runs.metadata import file_name
from .methods import (
    Settings,
    applies,
    config_of,
    environment,
    import_all,
    method_of,
    register_method,
    registered,
    same_config,
    teacher_cell,
)
from .record import Cell, Record, RecordError
from .tables import RUNTIME_VARIANTS, TABLES, Row, Table

ALL = "all"
PLAIN = "plain"
"""Selects the rows of a table that have no variant."""
RESULT = "bench.json"
"""The file with a unit's result, in its folder."""

Result: TypeAlias = dict[str, Any]
"""The returns of a unit and everything else that `record_of` needs."""


@dataclass(frozen=True)
class Unit:
    """One training of a cell, or one tree made from a training."""

    cell: Cell
    seed: int
    settings: Settings
    runs: Path
    """The folder of all units, absolute."""

    @property
    def name(self) -> str:
        """The name in progress and errors."""
        return f"{self.cell.environment} {'-'.join(filter(None, self.cell[1:]))} seed {self.seed}"

    @property
    def folder(self) -> Path:
        """The folder of the unit's run."""
        cell = "-".join(filter(None, self.cell[1:]))
        return self.runs / file_name(self.cell.environment) / cell / f"seed-{self.seed}"

    @property
    def teacher(self) -> Unit | None:
        """The training that a tree is made from; None for a unit that trains."""
        cell = teacher_cell(self.cell)
        return None if cell is None else Unit(cell, self.seed, self.settings, self.runs)

    def result(self) -> Result | None:
        """Return the result if there is one with the config of today, else None."""
        try:
            result = parse_json(files.read_text(self.folder / RESULT), "it", strict=False)
            return result if same_config(result["config"], config_of(self.cell, self.settings)) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None  # there is none, or a damaged one: it is made again


def jobs_of(units: Iterable[Unit]) -> list[list[Unit]]:
    """Group units into jobs: most alone, and those that take turns together."""
    jobs: dict[Any, list[Unit]] = {}
    for unit in units:
        is_alone = (
            unit.cell.variant not in RUNTIME_VARIANTS
            or unit.teacher is not None
            or registered(unit.cell.method)
        )
        key = unit if is_alone else (unit.cell._replace(method=""), unit.seed)
        jobs.setdefault(key, []).append(unit)
    return list(jobs.values())


def task_of(job: Sequence[Unit], modules: Sequence[str] = ()) -> Task:
    """Return a job as a task for a worker.

    Args:
        job: One unit, or several that are trained together and differ only in their methods.
        modules: Modules that register environments or methods; the worker imports them.
    """
    first = job[0]
    cells = [unit.cell for unit in job]
    arguments = {
        "cells": [list(cell) for cell in cells],
        "seed": first.seed,
        "settings": list(first.settings),
        "runs": str(first.runs),
        "modules": list(modules),
        "makes": {cell.method: where for cell in cells if (where := registered(cell.method)) is not None},
    }
    if len(job) == 1:
        return Task(first.name, "sympol.bench.worker:run_unit", arguments)
    methods = " ".join(cell.method for cell in cells)
    name = f"{first.cell.environment} {first.cell.algo} {methods} in turns, seed {first.seed}"
    return Task(name, "sympol.bench.worker:run_together", arguments)


def units_of(
    cells: Sequence[Sequence[str]],
    seed: int,
    settings: Sequence[int],
    runs: str,
    modules: Sequence[str],
    makes: Mapping[str, str],
) -> list[Unit]:
    """Return the units of a task in its worker, after registering there what the parent has registered.

    The arguments are those that `task_of` puts into a task.
    """
    import_all(modules)
    for name, where in makes.items():
        register_method(name, where)
    seed = require_training_seed(seed)
    return [Unit(Cell(*cell), seed, Settings(*settings), Path(runs)) for cell in cells]


@dataclass(frozen=True)
class CellPlan:
    """A selected cell and what it lacks."""

    cell: Cell
    config: Mapping[str, Any]
    """The config that the cell must have."""
    record: Record | None
    """The record that exists with this config, if any."""
    units: tuple[Unit, ...]
    """The units to run; none if the cell is finished."""
    status: str
    """The state of the cell, for people."""


def tables_of(name: str) -> tuple[Table, ...]:
    """Return the table of a name, or all tables for `ALL`.

    Raises:
        ValueError: There is no such table; the message names all.
    """
    if name == ALL:
        return tuple(TABLES.values())
    if name not in TABLES:
        raise ValueError(f"unknown table {name!r}; there are {', '.join(TABLES)}, and {ALL}")
    return (TABLES[name],)


def selected(
    table: Table, environments: Sequence[str] = (), methods: Sequence[str] = (), variants: Sequence[str] = ()
) -> Table:
    """Return the selected part of a table, extended by what the table does not have.

    Args:
        table: The table.
        environments: Names of environments; by default those of the table.
        methods: Names of methods; by default those of the table.
        variants: Names of variants, or `PLAIN`; by default those of the table.

    Raises:
        ValueError: A method is unknown.
    """
    algos = dict.fromkeys(row.algo for row in table.rows)
    rows = [row for row in table.rows if not methods or row.method in methods]
    new = [method for method in methods if method not in {row.method for row in rows}]
    rows += [Row(method, algo=algo) for method, algo in product(new, algos)]
    if variants:
        plain = dict.fromkeys(row._replace(variant="") for row in rows)
        names = ["" if variant == PLAIN else variant for variant in variants]
        rows = [row._replace(variant=name) for row, name in product(plain, names)]
    for row in rows:
        method_of(row.method)
    return dataclasses.replace(
        table, environments=tuple(environments) or table.environments, rows=tuple(dict.fromkeys(rows))
    )


def cells_of(tables: Iterable[Table]) -> list[Cell]:
    """Return all cells of some tables that can exist, each once."""
    cells = dict.fromkeys(cell for table in tables for cell in table.cells())
    for name in dict.fromkeys(cell.environment for cell in cells):
        environment(name)
    return [cell for cell in cells if applies(cell)]


def plan_cells(
    cells: Iterable[Cell],
    records: Mapping[Cell, Record],
    settings: Settings,
    seeds: Sequence[int],
    runs: Path,
) -> list[CellPlan]:
    """Plan what some cells lack. If one of several cells that are trained in turns lacks a seed, all run it.

    Args:
        cells: The cells.
        records: The records that exist.
        settings: Lengths of trainings and numbers of episodes.
        seeds: Seeds of the trainings of each cell.
        runs: The folder of all runs.

    Raises:
        RecordError: A record would be replaced by a smaller one.
    """
    plans = [plan_cell(cell, records.get(cell), settings, seeds, runs) for cell in cells]
    for group in jobs_of(Unit(plan.cell, 0, settings, runs) for plan in plans):
        members = [i for i, plan in enumerate(plans) if plan.cell in {unit.cell for unit in group}]
        lacking = sorted({unit.seed for i in members for unit in plans[i].units})
        for i in members:
            units = tuple(Unit(plans[i].cell, seed, settings, runs) for seed in lacking)
            plans[i] = dataclasses.replace(plans[i], units=units)
    return plans


def plan_cell(
    cell: Cell, record: Record | None, settings: Settings, seeds: Sequence[int], runs: Path
) -> CellPlan:
    """Plan what one cell lacks; see `plan_cells`."""
    config = config_of(cell, settings)
    if record is None:
        current, missing, status = None, seeds, "not run"
    elif same_config(record.config, config):
        current, missing = record, record.missing(seeds)
        status = f"{len(record.seeds)} trainings"
    else:
        _require_no_less(record, settings, len(seeds))
        current, missing = None, seeds
        status = f"changed: {', '.join(changes(record.config, config))}"
    units = tuple(Unit(cell, seed, settings, runs) for seed in missing)
    return CellPlan(cell, config, current, units, status)


def changes(was: Mapping[str, Any], now: Mapping[str, Any], name: str = "") -> list[str]:
    """Return the differences between two configs, each as ``name 1 → 2``.

    Args:
        was: The config of a record.
        now: The config of today.
        name: The name of the part that is compared, with a dot at its end.
    """
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        found = []
        for key in dict.fromkeys([*was, *now]):
            if not same_config({"part": was.get(key)}, {"part": now.get(key)}):  # alike once they are JSON
                found += changes(was.get(key, "nothing"), now.get(key, "nothing"), f"{name}{key}.")
        return found
    return [f"{name.rstrip('.')} {was} → {now}"]


def _require_no_less(record: Record, settings: Settings, trainings: int) -> None:
    """Refuse to replace a record that took hours by one of a bench that is only tried out."""
    was = (record.total_timesteps, len(record.returns[0]), len(record.seeds))
    now = (settings.total_timesteps, settings.episodes, trainings)
    if any(n < w for n, w in zip(now, was, strict=True)):
        words = [
            f"{n} training{'s' if n > 1 else ''} of {steps:,} steps, {episodes} episodes each"
            for steps, episodes, n in (was, now)
        ]
        raise RecordError(
            f"the record of {' '.join(filter(None, record.cell))} has {words[0]}, of another config, and would be "
            f"replaced by {words[1]}; write into another --root, or remove the record"
        )
