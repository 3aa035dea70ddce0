"""What a bench has to do: which cells were asked for, and what each of them lacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from .jobs import Unit, jobs_of
from .method_specs import Settings, applies, config_of, environment, method_of, same_config
from .record import Cell, Record, RecordError
from .tables import TABLES, Row, Table

ALL = "all"
PLAIN = "plain"
"""Asks for the rows of a table that have no variant."""


@dataclass(frozen=True)
class CellPlan:
    """A cell that was asked for."""

    cell: Cell
    config: Mapping[str, Any]
    """What it is to be made with."""
    record: Record | None
    """What there is of it, if that was made so."""
    units: tuple[Unit, ...]
    """What is to be done for it; nothing if it is finished."""
    was: str
    """What there is of it, in words."""


def tables_of(name: str) -> tuple[Table, ...]:
    """The table of a name, or all. Raises ValueError, naming them."""
    if name == ALL:
        return tuple(TABLES.values())
    if name not in TABLES:
        raise ValueError(f"unknown table {name!r}; there are {', '.join(TABLES)}, and {ALL}")
    return (TABLES[name],)


def selected(
    table: Table, environments: Sequence[str] = (), methods: Sequence[str] = (), variants: Sequence[str] = ()
) -> Table:
    """The part of a table that was asked for; what it does not have is added to it.

    Raises:
        ValueError: an unknown method or variant.
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
    """All cells of some tables that can be, each once."""
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
    """What some cells lack. Of those that are trained in turns, what one lacks is done for all.

    Raises:
        RecordError: what there is would be replaced by less.
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
    """What one cell lacks."""
    config = config_of(cell, settings)
    if record is None:
        kept, missing, was = None, seeds, "not run"
    elif same_config(record.config, config):
        kept, missing = record, record.missing(seeds)
        was = f"{len(record.seeds)} trainings"
    else:
        _require_no_less(record, settings, len(seeds))
        kept, missing, was = None, seeds, f"changed: {', '.join(changes(record.config, config))}"
    return CellPlan(cell, config, kept, tuple(Unit(cell, seed, settings, runs) for seed in missing), was)


def changes(was: Mapping[str, Any], now: Mapping[str, Any], name: str = "") -> list[str]:
    """What differs between two configs, each as ``name 1 → 2``."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        found = []
        for key in dict.fromkeys([*was, *now]):
            if not same_part(was.get(key), now.get(key)):
                found += changes(was.get(key, "nothing"), now.get(key, "nothing"), f"{name}{key}.")
        return found
    return [f"{name.rstrip('.')} {was} → {now}"]


def same_part(was: Any, now: Any) -> bool:
    """Whether two parts of configs are alike once they are written as JSON."""
    return same_config({"part": was}, {"part": now})


def _require_no_less(record: Record, settings: Settings, trainings: int) -> None:
    """A bench that is only tried out must not replace one that took hours."""
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
