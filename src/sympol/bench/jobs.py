"""One training of one cell: where it is kept, and the task that `bench` gives to workers for it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from .. import files
from ..bounded import parse_json
from ..parallel import Task
from ..results.seeds import require_training_seed
from ..runs.metadata import file_name
from .method_specs import Settings, config_of, import_all, own, register_method, same_config, teacher_cell
from .methods import RUNTIME_VARIANTS
from .record import Cell

RESULT = "bench.json"

Result: TypeAlias = dict[str, Any]
"""Its returns and what else `record_of` asks for."""


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
        return self.runs / file_name(self.cell.environment) / cell / f"seed-{self.seed}"

    @property
    def teacher(self) -> Unit | None:
        """The training that it makes a tree of."""
        cell = teacher_cell(self.cell)
        return None if cell is None else Unit(cell, self.seed, self.settings, self.runs)

    def result(self) -> Result | None:
        """What came of it, if it is finished, and was made as it would be now."""
        try:
            result = parse_json(files.read_text(self.folder / RESULT), "it", strict=False)
            return result if same_config(result["config"], config_of(self.cell, self.settings)) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None  # none there, or a damaged one: it is made again


def task_of(units: Sequence[Unit], modules: Sequence[str] = ()) -> Task:
    """The same for a worker: one unit, or some that are trained together, which differ in their methods."""
    first = units[0]
    cells = [unit.cell for unit in units]
    arguments = {
        "cells": [list(cell) for cell in cells],
        "seed": first.seed,
        "settings": list(first.settings),
        "runs": str(first.runs),
        "modules": list(modules),
        "makes": {cell.method: where for cell in cells if (where := own(cell.method)) is not None},
    }
    if len(units) == 1:
        return Task(first.name, "sympol.bench.run:run_unit", arguments)
    methods = " ".join(cell.method for cell in cells)
    name = f"{first.cell.environment} {first.cell.algo} {methods} in turns, seed {first.seed}"
    return Task(name, "sympol.bench.runtime:run_together", arguments)


def units_of(
    cells: Sequence[Sequence[str]],
    seed: int,
    settings: Sequence[int],
    runs: str,
    modules: Sequence[str],
    makes: Mapping[str, str],
) -> list[Unit]:
    """What `task_of` was given, in the worker; registers there what was registered here."""
    import_all(modules)
    for slug, where in makes.items():
        register_method(slug, where)
    seed = require_training_seed(seed)
    return [Unit(Cell(*cell), seed, Settings(*settings), Path(runs)) for cell in cells]


def jobs_of(units: Iterable[Unit]) -> list[list[Unit]]:
    """Units to be done one by one, and those that take turns together."""
    jobs: dict[Any, list[Unit]] = {}
    for unit in units:
        is_alone = (
            unit.cell.variant not in RUNTIME_VARIANTS or unit.teacher is not None or own(unit.cell.method)
        )
        key = unit if is_alone else (unit.cell._replace(method=""), unit.seed)
        jobs.setdefault(key, []).append(unit)
    return list(jobs.values())
