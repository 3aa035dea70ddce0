"""``sympol bench``: the tables of the paper; what they lack is run."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Shown

from ..threads import use_one_thread
from .arguments import Flag, OptionalPath, Text, Texts, Workers, parse
from .console import err, out, print_error

if TYPE_CHECKING:
    from ..bench.grids import Grid
    from ..bench.plan import CellPlan
    from ..bench.record import Record
    from ..bench.tables import Table
    from ..parallel import Failure

WIDTH = 200
"""The width of a table that is written into a file or a pipe, in characters."""


@dataclass
class Selection:
    """Run and print only a part of the table, or add to it."""

    environments: Texts = ()
    """Gymnasium ids, file.py:Name or module:Name; those that the table does not have are added to it."""

    methods: Texts = ()
    """Any of tree, mlp, sdt, d-sdt, sa-dt-5, sa-dt-8, viper-5, viper-8, dagger-5, dagger-8, tree-paper, mlp-paper,
    sdt-paper, or NAME=MODULE:FUNCTION for a method of your own; those that the table does not have are added to it."""

    variants: Texts = ()
    """Variants of an ablation, such as static-batch; plain is the method without one."""

    imports: Texts = ()
    """Modules that register environments or methods of your own; workers import them, too."""


@dataclass
class Trainings:
    """Set the number and the length of trainings. The defaults are those of the tables."""

    trainings: int = 5
    """Number of trainings of each cell, with the seeds 0, 1, ..."""

    episodes: int = 100
    """Number of test episodes of each training on Gymnasium, and as many with sampled actions and for validation."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""


@dataclass
class Folders:
    """Choose where results are read and written."""

    root: Path = Path()
    """The folder that holds results/cells, results/tables, runs/bench and docs."""

    runs: OptionalPath = None
    """The folder of the trainings' runs; by default ROOT/runs/bench."""

    out: OptionalPath = None
    """The folder of the tables; by default ROOT/results/tables."""


@dataclass
class Bench:
    """Run what a table of the paper lacks and write it as Markdown, LaTeX, CSV and plots, beside the paper's numbers.

    A cell of a table is a few trainings, each an ordinary run folder. A finished cell is a small file in
    ROOT/results/cells and is run again only if its config changes. After an interruption the same command resumes.

    Show what is finished and what is left to run: sympol bench control-ppo --list

    Make the paper's first table on two cores: sympol bench control-ppo --workers 2

    Add an environment of your own: sympol bench control-ppo --environments my_package:My-v0

    Compare a method of your own: sympol bench control-ppo --methods tree mlp mine=my_package.method:train
    """

    table: Annotated[Text, tyro.conf.arg(metavar="TABLE")]
    """control-ppo, control-a2c, ppo-vs-a2c, minigrid, information-loss, viper-control, viper-minigrid, tree-size,
    ablation, runtime, training-curves, or all."""

    list: Flag = False
    """Show what is finished and what is left to run, and stop."""

    render_only: Flag = False
    """Write the tables from the records that exist, and run nothing."""

    selection: Selection = field(default_factory=Selection)
    trainings: Trainings = field(default_factory=Trainings)
    processes: Workers = field(default_factory=Workers)
    folders: Folders = field(default_factory=Folders)


def run(words: Sequence[str]) -> int:
    """Run ``sympol bench``.

    Args:
        words: The words after the command's name.

    Returns:
        The exit status: 1 if a training failed, else 0.
    """
    given = parse(Bench, "bench", words)

    from ..bench.run import run as run_plans

    use_one_thread()
    extended, parts = _tables(given)
    if given.list:
        return _list(_plans(given, parts))
    failures: list[Failure] = []
    if not given.render_only:
        plans = _plans(given, parts)
        _print_plans(plans)
        failures = run_plans(
            plans,
            root=given.folders.root,
            runs=_runs(given),
            workers=given.processes.workers,
            scheduler=given.processes.scheduler,
            modules=given.selection.imports,
            on_record=_print_record,
        )
    _write(given, extended, parts)
    for failure in failures:
        print_error(RuntimeError(f"{failure.task.name}: {failure.reason}"))
    return 1 if failures else 0


def _tables(given: Bench) -> tuple[list[Table], list[Table]]:
    """Return the tables as they are written, and the parts of them that are selected."""
    from ..bench.methods import import_all
    from ..bench.plan import selected, tables_of
    from ..results.seeds import TRAINING

    if not 1 <= given.trainings.trainings <= len(TRAINING):
        raise ValueError(f"--trainings must be from 1 to {len(TRAINING)}, got {given.trainings.trainings}")
    for part, name in (
        (given.trainings, "episodes"),
        (given.trainings, "total_timesteps"),
        (given.processes, "workers"),
    ):
        if getattr(part, name) < 1:
            raise ValueError(f"--{name.replace('_', '-')} must be at least 1, got {getattr(part, name)}")
    chosen = given.selection
    import_all(chosen.imports)
    methods = [_method(method) for method in chosen.methods]
    tables = list(tables_of(given.table))
    parts = [selected(table, chosen.environments, methods, chosen.variants) for table in tables]
    extended = [
        table.with_(
            environments=part.environments,
            methods=[row.method for row in part.rows if row not in table.rows and not row.variant],
        )
        for table, part in zip(tables, parts, strict=True)
    ]
    return extended, parts


def _method(text: str) -> str:
    """Return a method's name; ``NAME=MODULE:FUNCTION`` also registers it."""
    from ..bench.methods import register_method

    name, equals, where = text.partition("=")
    if equals:
        register_method(name, where)
    return name


def _plans(given: Bench, tables: Iterable[Table]) -> list[CellPlan]:
    from ..bench.methods import Settings
    from ..bench.plan import cells_of, plan_cells
    from ..bench.record import load_all
    from ..bench.summary import by_cell
    from ..results.seeds import TRAINING

    records = by_cell(load_all(given.folders.root))
    settings = Settings(given.trainings.total_timesteps, given.trainings.episodes)
    seeds = TRAINING[: given.trainings.trainings]
    return plan_cells(cells_of(tables), records, settings, seeds, _runs(given))


def _runs(given: Bench) -> Path:
    return Path(os.path.abspath(given.folders.runs or given.folders.root / "runs" / "bench"))


def _list(plans: Iterable[CellPlan]) -> int:
    for plan in plans:
        todo = f"{len(plan.units)} to run" if plan.units else "finished"
        out.print(f"{' '.join(filter(None, plan.cell)):<50} {todo:<12} {plan.status}", markup=False)
    return 0


def _print_plans(plans: Sequence[CellPlan]) -> None:
    todo = [plan for plan in plans if plan.units]
    units = sum(len(plan.units) for plan in todo)
    err.print(
        f"{len(plans) - len(todo)} of {len(plans)} cells are finished; {units} trainings or trees to run"
    )


def _print_record(record: Record, path: Path) -> None:
    mean = sum(map(sum, record.returns)) / sum(map(len, record.returns))
    err.print(f"{path}: {len(record.seeds)} trainings, mean return {mean:,.3f}", markup=False)


def _write(given: Bench, tables: Sequence[Table], parts: Sequence[Table]) -> None:
    """Write the tables, and print the selected parts of them."""
    from ..bench.grids import grids
    from ..bench.plan import ALL
    from ..bench.record import load_all, results_folder
    from ..bench.render import write, write_docs
    from ..bench.summary import by_cell

    records = load_all(given.folders.root)
    found = by_cell(records)
    folder = given.folders.out or results_folder(given.folders.root) / "tables"
    wide = out if out.is_terminal else Console(width=WIDTH, highlight=False, emoji=False)
    for table, part in zip(tables, parts, strict=True):
        written = write(table, records, folder)
        for grid in grids(part, found):
            wide.print(_shown(part, grid))
        err.print(f"written to {', '.join(map(str, written))}", markup=False)
        missing = sum(cell not in found for cell in table.cells())
        if missing:
            words = shlex.join(_command(given, table.name))
            err.print(
                f"{missing} of its {len(table.cells())} cells are not run; to run them: {words}", markup=False
            )
    if given.table == ALL:
        page, *_ = write_docs(records, given.folders.root / "docs", tables)
        err.print(f"all on one page: {page}", markup=False)


def _command(given: Bench, table: str) -> list[str]:
    """Return the command that runs a whole table with the same sizes, processes and folders."""
    words = ["sympol", "bench", table]
    for part in (given.trainings, given.processes, given.folders):
        for name, value in vars(part).items():
            if value != getattr(type(part), name):
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
