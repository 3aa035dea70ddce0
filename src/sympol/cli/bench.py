"""``sympol bench``: the tables of the paper; what they lack is run."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Shown

from ..threads import use_one_thread
from .arguments import Text, parse
from .console import err, out, print_error

if TYPE_CHECKING:
    from ..bench.grids import Grid
    from ..bench.plan import CellPlan
    from ..bench.record import Record
    from ..bench.tables import Table
    from ..parallel import Failure

WIDTH = 200
"""Of a table that is written to a file, or into a pipe."""


@dataclass
class Bench:
    """Run what a table lacks, and write it: Markdown, LaTeX, CSV and plots, the paper's numbers beside ours.

    Each cell is some trainings, ordinary run folders, and ends as one small file in ROOT/results/cells. A finished
    cell is never run again unless its config has changed; what was interrupted (Ctrl-C) goes on where it was.

    What there is to do, and what it would take the place of: sympol bench control-ppo --list

    The paper's first table on two processors: sympol bench control-ppo --workers 2

    Your environment: sympol bench control-ppo --environments my_package:My-v0

    Your method beside ours: sympol bench control-ppo --methods tree mlp mine=my_package.method:train
    """

    table: Annotated[Text, tyro.conf.arg(metavar="TABLE")]
    """control-ppo, control-a2c, ppo-vs-a2c, minigrid, information-loss, viper-control, viper-minigrid, tree-size,
    ablation, runtime, training-curves, or all."""

    environments: tuple[str, ...] = ()
    """Only these, or others in their place: any Gymnasium id."""

    methods: tuple[str, ...] = ()
    """Only these, or others in their place: tree, mlp, sdt, d-sdt, sa-dt-5, sa-dt-8, viper-5, viper-8, dagger-5,
    dagger-8, tree-paper, mlp-paper, sdt-paper; NAME=MODULE:FUNCTION for one of your own."""

    variants: tuple[str, ...] = ()
    """Only these ablations, such as static-batch."""

    trainings: int = 5
    """Of each cell; their seeds are 0, 1, ..."""

    episodes: int = 100
    """Test episodes of each training on Gymnasium; as many in which actions are sampled, and for validation."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""

    workers: int = 1
    """Processes on this machine."""

    scheduler: str | None = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    root: Path = Path()
    """Where results/cells, results/tables, runs/bench and docs are."""

    runs: Path | None = None
    """Where run folders are kept; ROOT/runs/bench by default."""

    out: Path | None = None
    """Where tables are written; ROOT/results/tables by default."""

    imports: tuple[str, ...] = ()
    """Modules that register environments or methods of your own; workers import them, too."""

    list: bool = False
    """Say what is finished and what there is to run, and stop."""

    render_only: bool = False
    """Write the tables from the records there are, and run nothing."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol bench``."""
    given = parse(Bench, "bench", words)

    from ..bench.bench import run as run_plans

    use_one_thread()
    whole, tables = _tables(given)
    if given.list:
        return _list(_plans(given, tables))
    failures: list[Failure] = []
    if not given.render_only:
        plans = _plans(given, tables)
        _say_plan(plans)
        failures = run_plans(
            plans,
            root=given.root,
            runs=_runs(given),
            workers=given.workers,
            scheduler=given.scheduler,
            modules=given.imports,
            on_record=_say_record,
        )
    _write(given, whole, tables)
    for failure in failures:
        print_error(RuntimeError(f"{failure.task.name}: {failure.reason}"))
    return 1 if failures else 0


def _tables(given: Bench) -> tuple[list[Table], list[Table]]:
    """The tables as they are written, and the parts of them that were asked for."""
    from ..bench.method_specs import import_all
    from ..bench.plan import selected, tables_of
    from ..results.seeds import TRAINING

    if not 1 <= given.trainings <= len(TRAINING):
        raise ValueError(f"--trainings must be from 1 to {len(TRAINING)}, got {given.trainings}")
    for name in ("episodes", "total_timesteps", "workers"):
        if getattr(given, name) < 1:
            raise ValueError(f"--{name.replace('_', '-')} must be at least 1, got {getattr(given, name)}")
    import_all(given.imports)
    methods = [_method(method) for method in given.methods]
    whole = list(tables_of(given.table))
    parts = [selected(table, given.environments, methods, given.variants) for table in whole]
    extended = [
        table.with_(
            environments=part.environments,
            methods=[row.method for row in part.rows if row not in table.rows and not row.variant],
        )
        for table, part in zip(whole, parts, strict=True)
    ]
    return extended, parts


def _method(text: str) -> str:
    """A method's name; with ``NAME=MODULE:FUNCTION`` it is registered."""
    from ..bench.method_specs import register_method

    slug, equals, where = text.partition("=")
    if equals:
        register_method(slug, where)
    return slug


def _plans(given: Bench, tables: Iterable[Table]) -> list[CellPlan]:
    from ..bench.method_specs import Settings
    from ..bench.plan import cells_of, plan_cells
    from ..bench.record import load_all
    from ..bench.summary import by_cell
    from ..results.seeds import TRAINING

    records = by_cell(load_all(given.root))
    settings = Settings(given.total_timesteps, given.episodes)
    seeds = TRAINING[: given.trainings]
    return plan_cells(cells_of(tables), records, settings, seeds, _runs(given))


def _runs(given: Bench) -> Path:
    return Path(os.path.abspath(given.runs or given.root / "runs" / "bench"))


def _list(plans: Iterable[CellPlan]) -> int:
    for plan in plans:
        todo = f"{len(plan.units)} to run" if plan.units else "finished"
        out.print(f"{' '.join(filter(None, plan.cell)):<50} {todo:<12} {plan.was}", markup=False)
    return 0


def _say_plan(plans: Sequence[CellPlan]) -> None:
    todo = [plan for plan in plans if plan.units]
    units = sum(len(plan.units) for plan in todo)
    err.print(
        f"{len(plans) - len(todo)} of {len(plans)} cells are finished; {units} trainings or trees to run"
    )


def _say_record(record: Record, path: Path) -> None:
    mean = sum(map(sum, record.returns)) / sum(map(len, record.returns))
    err.print(f"{path}: {len(record.seeds)} trainings, mean return {mean:,.3f}", markup=False)


def _write(given: Bench, whole: Sequence[Table], parts: Sequence[Table]) -> None:
    from ..bench.grids import grids
    from ..bench.plan import ALL
    from ..bench.record import load_all, results_folder
    from ..bench.render import write, write_docs
    from ..bench.summary import by_cell

    records = load_all(given.root)
    found = by_cell(records)
    folder = given.out or results_folder(given.root) / "tables"
    wide = out if out.is_terminal else Console(width=WIDTH, highlight=False, emoji=False)
    for table, part in zip(whole, parts, strict=True):
        written = write(table, records, folder)
        for grid in grids(part, found):
            wide.print(_shown(part, grid))
        err.print(f"written to {', '.join(map(str, written))}", markup=False)
        missing = sum(cell not in found for cell in table.cells())
        if missing:
            words = shlex.join(_again(given, table.name))
            err.print(
                f"{missing} of its {len(table.cells())} cells are not run; to run them: {words}", markup=False
            )
    if given.table == ALL:
        page, *_ = write_docs(records, given.root / "docs", whole)
        err.print(f"all on one page: {page}", markup=False)


def _again(given: Bench, table: str) -> list[str]:
    """The command for a whole table, with what was said of how to run it."""
    words = ["sympol", "bench", table]
    for name in ("trainings", "episodes", "total_timesteps", "workers", "scheduler", "root", "runs", "out"):
        if (value := getattr(given, name)) != getattr(Bench, name):
            words += [f"--{name.replace('_', '-')}", str(value)]
    return words


def _shown(table: Table, grid: Grid) -> Shown:
    title = ": ".join(filter(None, [table.title, grid.title]))
    shown = Shown(title=escape(title), caption=escape(grid.note))
    shown.add_column("")
    for column in grid.columns:
        shown.add_column(escape(column), justify="right")
    for name, entries in grid.rows:
        cells = [
            f"{'[bold]' if entry.bold else ''}{escape(entry.text)}{'[/]' if entry.bold else ''}"
            + (f"\n[dim]{escape(entry.detail)}[/]" if entry.detail else "")
            for entry in entries
        ]
        shown.add_row(escape(name), *cells)
    return shown
