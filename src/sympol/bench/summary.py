"""The numbers of a table: those of each cell, its comparisons, and those of rows over environments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..results.statistics import (
    Interval,
    Moments,
    bootstrap_interval,
    cohens_d,
    d_interval,
    interquartile_mean,
    mean_interval_of,
    moments,
    normalised,
    normalised_mean,
    reference,
    training_means,
)
from .comparisons import Comparison, against, best_and_not_different
from .record import Cell, Record, RecordError
from .tables import Row, Table, cell_of, is_tree


@dataclass(frozen=True)
class CellSummary:
    """The numbers of a cell that was run. Moments are over trainings."""

    record: Record
    test: Moments
    validation: Moments | None
    sampled: Moments | None
    nodes: Moments | None
    seconds: Moments | None
    loss: Interval | None
    """Cohen's d, validation less test, with the interval of the noncentral t distribution."""
    loss_by_bootstrap: Interval | None
    """Cohen's d with the interval of a percentile bootstrap."""
    best: Comparison | None = None
    """Compared with the best of its family: Welch's test, Holm's correction."""
    best_by_permutation: Comparison | None = None
    first: Comparison | None = None
    """Compared with the table's first row, in tables that compare rows with it."""

    @property
    def is_among_best(self) -> bool:
        """True if the cell is the best of at least two, or not different from the best."""
        return self.best is not None and not self.best.is_different


class Overall(NamedTuple):
    """The normalised returns of a row over all environments of a table."""

    mean: Interval
    interquartile_mean: Interval


def by_cell(records: Iterable[Record]) -> dict[Cell, Record]:
    """Return records by their cells.

    Raises:
        RecordError: Two records are of one cell.
    """
    found: dict[Cell, Record] = {}
    for record in records:
        if record.cell in found:
            raise RecordError(
                f"two records of {record.cell}; a table shows one: give each method or variant its name"
            )
        found[record.cell] = record
    return found


def summarise(table: Table, records: Mapping[Cell, Record]) -> dict[Cell, CellSummary]:
    """Return the numbers of all cells of a table that were run.

    Args:
        table: The table, which says what is compared.
        records: The records by cell.
    """
    run = {cell: records[cell] for cell in table.cells() if cell in records}
    best, permuted, first = {}, {}, {}
    for family in _families(table, run).values():
        values = {cell: training_means(run[cell].returns) for cell in family}
        if len(values) > 1:
            best |= best_and_not_different(values)
            permuted |= best_and_not_different(values, test="permutation")
        base = cell_of(table.rows[0], family[0].environment)
        if table.compared == "baseline" and base in values:
            first |= against(values, base)
    return {cell: _summary(run[cell], best.get(cell), permuted.get(cell), first.get(cell)) for cell in run}


def values_of(table: Table, row: Row, records: Mapping[Cell, Record]) -> list[np.ndarray] | None:
    """Return a row's mean test returns, ``[trainings]`` for each environment; None if a cell is missing."""
    cells = [cell_of(row, env) for env in table.environments]
    return (
        [training_means(records[cell].returns) for cell in cells]
        if all(c in records for c in cells)
        else None
    )


def scores(table: Table, records: Mapping[Cell, Record]) -> dict[Row, list[np.ndarray]]:
    """Return the normalised returns of all complete rows, ``[trainings]`` for each environment.

    The table's reference rows that have records define 0 and 1 (`statistics.reference`).
    """
    references = []
    for env in table.environments:
        cells = [cell_of(row, env) for row in table.reference_rows or table.rows]
        rows = [training_means(records[cell].returns) for cell in cells if cell in records]
        if not rows:
            return {}
        references.append(reference(rows))
    complete = {row: values for row in table.rows if (values := values_of(table, row, records)) is not None}
    return {
        row: [normalised(x, between) for x, between in zip(values, references, strict=True)]
        for row, values in complete.items()
    }


def overall(table: Table, records: Mapping[Cell, Record]) -> dict[Row, Overall]:
    """Return the numbers of complete rows over all environments; the intervals take the returns of 0 and 1 as known."""
    return {
        row: Overall(
            bootstrap_interval(strata, normalised_mean), bootstrap_interval(strata, interquartile_mean)
        )
        for row, strata in scores(table, records).items()
    }


def mean_loss(table: Table, row: Row, records: Mapping[Cell, Record]) -> Interval | None:
    """Return the mean over environments of a row's Cohen's d; None if a cell is missing or has one training."""
    pairs = [_pairs(records.get(cell_of(row, env))) for env in table.environments]
    known = [pair for pair in pairs if pair is not None]
    return mean_interval_of([d_interval(pair) for pair in known]) if len(known) == len(pairs) else None


def curve_means(record: Record) -> np.ndarray | None:
    """Return the mean over each training of its validation returns, ``[trainings]``; None if there are no curves."""
    if record.curves is None:
        return None
    return np.array([np.mean(curve["returns"]) for curve in record.curves])


def _families(table: Table, run: Mapping[Cell, Record]) -> dict[tuple[str, ...], list[Cell]]:
    """Return the families of cells that are compared with each other."""
    families: dict[tuple[str, ...], list[Cell]] = {}
    for cell, record in run.items():
        match table.compared:
            case "trees" if is_tree(record):
                families.setdefault((cell.environment, cell.algo), []).append(cell)
            case "algos":
                families.setdefault((cell.environment, cell.method, cell.variant), []).append(cell)
            case "baseline":
                families.setdefault((cell.environment,), []).append(cell)
    return families


def _summary(record: Record, *comparisons: Comparison | None) -> CellSummary:
    pairs = _pairs(record)
    return CellSummary(
        record,
        moments(training_means(record.returns)),
        None if record.validation_returns is None else moments(training_means(record.validation_returns)),
        None if record.sampled_returns is None else moments(training_means(record.sampled_returns)),
        None if record.nodes is None else moments(record.nodes),
        None if record.seconds is None else moments(record.seconds),
        None if pairs is None else d_interval(pairs),
        None if pairs is None else bootstrap_interval([pairs], cohens_d),
        *comparisons,
    )


def _pairs(record: Record | None) -> np.ndarray | None:
    """Return the mean validation and the mean test return of each training, ``[trainings, 2]``."""
    if record is None or record.validation_returns is None or len(record.seeds) < 2:
        return None
    return np.stack([training_means(record.validation_returns), training_means(record.returns)], axis=1)
