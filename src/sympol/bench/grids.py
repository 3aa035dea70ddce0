"""The text of a table's cells, before it is written in any format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from ..results.formatting import Entry, Grid, as_printed, interval, number, spread
from ..results.statistics import Interval, Moments, moments
from .record import Cell, Record
from .summary import CellSummary, curve_means, mean_loss, overall, summarise
from .tables import (
    MEAN,
    SHORT,
    TIMESTEPS,
    VARIANT_LABELS,
    Quantity,
    Row,
    Table,
    cell_of,
    exists,
    label_of,
    paper_number,
)

NOT_RUN = "not run"
IMPOSSIBLE = "—"


def grids(table: Table, records: Mapping[Cell, Record]) -> list[Grid]:
    """Return the grids of a table, filled from records.

    Args:
        table: The table.
        records: The records by cell; cells without one are shown as not run.
    """
    summaries = summarise(table, records)
    match table.kind:
        case "returns":
            return [_cells(table, table.caption, summaries, _return), _overall(table, records)]
        case "loss":
            return [
                _cells(table, table.caption, summaries, _before_and_after),
                _losses(table, records, summaries),
            ]
        case "size":
            return [_with_mean(table, summaries, "nodes", table.environments)]
        case "runtime":
            alike = tuple(env for env in table.environments if SHORT.get(env) != "LL")  # as in the paper
            return [_with_mean(table, summaries, "seconds", alike), _ratios(table, records)]
        case "curves":
            return [_cells(table, table.caption, summaries, _area)]


def name_of(table: Table, row: Row) -> str:
    """Return a row's name, which ends with its algorithm if the table has more than one."""
    several = len({row.algo for row in table.rows}) > 1
    if row.variant in VARIANT_LABELS and len({row.method for row in table.rows}) == 1:
        return VARIANT_LABELS[row.variant]  # the first row names what all have in common
    return label_of(cell_of(row, "")) + (f", {row.algo.upper()}" if several else "")


def _cells(
    table: Table,
    note: str,
    summaries: Mapping[Cell, CellSummary],
    show: Callable[[Cell, CellSummary | None, int], Entry],
) -> Grid:
    rows = []
    for row in table.rows:
        entries = []
        for env in table.environments:
            cell = cell_of(row, env)
            entries.append(
                show(cell, summaries.get(cell), _places(summaries, env))
                if exists(cell)
                else Entry(IMPOSSIBLE)
            )
        rows.append((name_of(table, row), tuple(entries)))
    if note and any(entry.text == IMPOSSIBLE for _, entries in rows for entry in entries):
        note += f" {IMPOSSIBLE}: the method is for discrete actions."
    return Grid("", note, table.environments, tuple(rows))


def _return(cell: Cell, summary: CellSummary | None, places: int) -> Entry:
    paper = _paper("return", cell)
    if summary is None:
        return Entry(NOT_RUN, paper)
    mark = ""
    if summary.first is not None and summary.first.is_different:
        mark = " ▲" if summary.first.difference > 0 else " ▼"
    text = spread(summary.test, places) + mark
    return Entry(text, _joined(_trainings(summary.record), paper), summary.is_among_best)


def _before_and_after(cell: Cell, summary: CellSummary | None, places: int) -> Entry:
    before, after = paper_number("validation", cell), paper_number("return", cell)
    paper = (
        f"paper {as_printed(before)} → {as_printed(after)}"
        if before is not None and after is not None
        else ""
    )
    if summary is None:
        return Entry(NOT_RUN, paper)
    validation = spread(summary.validation, places) if summary.validation else "not validated"
    return Entry(f"{validation} → {spread(summary.test, places)}", _joined(_trainings(summary.record), paper))


def _losses(table: Table, records: Mapping[Cell, Record], summaries: Mapping[Cell, CellSummary]) -> Grid:
    def show(cell: Cell, summary: CellSummary | None, places: int) -> Entry:
        return _loss(summary.loss if summary else None, summary is not None, _paper("cohens_d", cell))

    grid = _cells(table, "", summaries, show)
    rows = []
    for row, (name, entries) in zip(table.rows, grid.rows, strict=True):
        mean = mean_loss(table, row, records)
        rows.append((name, (*entries, _loss(mean, False, _paper("cohens_d", cell_of(row, MEAN))))))
    note = (
        "Cohen's d, validation less test, over trainings; positive: something was lost. In brackets the 95 % interval "
        "of the noncentral t distribution. Bold: the interval is above 0."
    )
    return Grid("Cohen's d", note, (*table.environments, "mean"), tuple(rows))


def _loss(d: Interval | None, is_run: bool, paper: str) -> Entry:
    if d is None:
        return Entry("too few trainings" if is_run else NOT_RUN, paper)
    return Entry(interval(d), paper, d.low > 0)


def _overall(table: Table, records: Mapping[Cell, Record]) -> Grid:
    whole = overall(table, records)
    rows = []
    for row in table.rows:
        paper = _paper("return", cell_of(row, MEAN))
        if row not in whole:
            possible = all(exists(cell_of(row, env)) for env in table.environments)
            rows.append((name_of(table, row), (Entry(NOT_RUN if possible else IMPOSSIBLE, paper),) * 2))
            continue
        mean, middle = whole[row]
        rows.append((name_of(table, row), (Entry(interval(mean), paper), Entry(interval(middle)))))
    note = (
        "Normalised on each environment: 1 is the best row's mean, 0 the 20 % quantile of all trainings"
        f"{' of the first ' + str(len(table.reference_rows)) + ' rows' if table.reference_rows else ''}. In brackets "
        "the 95 % interval of a bootstrap of trainings, stratified by environment. Only rows that were run everywhere."
    )
    return Grid("Over all environments", note, ("normalised mean", "interquartile mean"), tuple(rows))


def _with_mean(
    table: Table, summaries: Mapping[Cell, CellSummary], quantity: Quantity, averaged: tuple[str, ...]
) -> Grid:
    """Return a grid of nodes or seconds, and a column of means over the ``averaged`` environments, if any."""

    def show(cell: Cell, summary: CellSummary | None, places: int) -> Entry:
        measured: Moments | None = getattr(summary, quantity, None)
        if summary is None or measured is None:
            return Entry(NOT_RUN if summary is None else "not measured", _paper(quantity, cell))
        return Entry(spread(measured, 1), _joined(_trainings(summary.record), _paper(quantity, cell)))

    grid = _cells(table, table.caption, summaries, show)
    if not averaged:
        return grid
    rows = []
    for row, (name, entries) in zip(table.rows, grid.rows, strict=True):
        found = [getattr(summaries.get(cell_of(row, env)), quantity, None) for env in averaged]
        means = [of.mean for of in found if of is not None]
        text = number(float(np.mean(means)), 1) if len(means) == len(averaged) else NOT_RUN
        rows.append((name, (*entries, Entry(text, _paper(quantity, cell_of(row, MEAN))))))
    without = [env for env in table.environments if env not in averaged]
    column = f"mean without {', '.join(without)}" if without else "mean"
    return grid._replace(columns=(*grid.columns, column), rows=tuple(rows))


def _ratios(table: Table, records: Mapping[Cell, Record]) -> Grid:
    """Return the ratios of each row's seconds to those of the last row of its variant, seed by seed."""
    last, rows = {row.variant: row for row in table.rows}, []
    for row in table.rows:
        entries, base = [], last[row.variant]
        if row == base:
            continue
        for env in table.environments:
            one, other = (records.get(cell_of(which, env)) for which in (row, base))
            if one is None or other is None or one.seconds is None or other.seconds is None:
                entries.append(Entry(NOT_RUN))
                continue
            beside = dict(zip(other.seeds, other.seconds, strict=True))
            ratios = [
                took / beside[s] for s, took in zip(one.seeds, one.seconds, strict=True) if beside.get(s)
            ]
            median = Interval(*np.quantile(ratios or [np.nan], [0.5, 0, 1]))
            entries.append(Entry(interval(median), f"n={len(ratios)}") if ratios else Entry(NOT_RUN))
        rows.append((name_of(table, row), tuple(entries)))
    names = ", ".join(name_of(table, base) for base in last.values())
    note = (
        f"Ratio of the seconds of trainings with the same seed: median [least, greatest]. Against: {names}."
    )
    return Grid("Ratios", note, table.environments, tuple(rows))


def _area(cell: Cell, summary: CellSummary | None, places: int) -> Entry:
    means = None if summary is None else curve_means(summary.record)
    if summary is None or means is None:
        return Entry(NOT_RUN if summary is None else "see its teacher")
    return Entry(spread(moments(means), places), _trainings(summary.record))


def _places(summaries: Mapping[Cell, CellSummary], env: str) -> int:
    """Return the number of decimals of an environment's returns: three if all are below 10."""
    means = [abs(summary.test.mean) for cell, summary in summaries.items() if cell.environment == env]
    return 3 if means and max(means) < 10 else 1


def _trainings(record: Record) -> str:
    steps = f"{record.total_timesteps:,} steps" if record.total_timesteps != TIMESTEPS else ""
    return _joined(f"n={len(record.seeds)}", steps)


def _paper(quantity: Quantity, cell: Cell) -> str:
    value = paper_number(quantity, cell)
    return "" if value is None else f"paper {as_printed(value)}"


def _joined(*parts: str) -> str:
    return "; ".join(filter(None, parts))


def not_run(table: Table, records: Iterable[Cell]) -> list[Cell]:
    """Return the cells of a table that have no record."""
    there = {*records}
    return [cell for cell in table.cells() if cell not in there]
