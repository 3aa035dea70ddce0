"""Plots of records: training curves, performance profiles, sizes of trees, information lost, ablations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..results.formatting import count
from ..results.statistics import Interval, performance_profile, training_means
from ..results.style import PANEL, legend_below, panels, save, style_of, styled
from .grids import name_of
from .record import Cell, Record
from .summary import overall, scores, summarise
from .tables import METHODS, Table, cell_of, method_or_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAIRED = ("sa-dt-5", "sa-dt-8", "d-sdt")
"""The post-hoc trees that are drawn beside SYMPOL."""


def figures(table: Table, records: Mapping[Cell, Record]) -> dict[str, Figure]:
    """Return all plots of a table for which there are records, by name."""
    with styled():
        match table.kind:
            case "curves":
                made = {"full": training_curves(table, records), "pairs": pairwise_curves(table, records)}
            case "returns" if table.compared == "baseline":
                made = {"overall": overall_marks(table, records)}
            case "returns" if table.compared == "trees":
                made = {"profiles": profiles(table, records)}
            case "size":
                made = {"nodes": tree_sizes(table, records)}
            case "loss":
                made = {"d": losses(table, records)}
            case _:
                made = {}
    return {name: figure for name, figure in made.items() if figure is not None}


def write_figures(
    table: Table, records: Mapping[Cell, Record], folder: Path, suffix: str = ".svg"
) -> list[Path]:
    """Write all plots of a table for which there are records.

    Args:
        table: The table.
        records: The records by cell.
        folder: The folder, created if it is missing.
        suffix: ``.svg``, ``.png`` or ``.pdf``.

    Returns:
        The paths ``<table>-<figure><suffix>``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return [
        save(figure, folder / f"{table.name}-{name}{suffix}")
        for name, figure in figures(table, records).items()
    ]


def profiles(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw the share of trainings above each normalised return, with pointwise 95 % bands, for all complete rows."""
    found = scores(table, records)
    if not found:
        return None
    figure, [[ax]] = panels(1, 1, height=1.5 * PANEL[1])
    figure.set_figwidth(2 * PANEL[0])
    thresholds, others = np.linspace(0, 1.05, 106), _others(table)
    for row, strata in found.items():
        of, style = performance_profile(strata, thresholds), style_of(row.method, others)
        ax.step(
            of.thresholds,
            of.share,
            where="post",
            color=style.colour,
            linestyle=style.line,
            label=name_of(table, row),
        )
        ax.fill_between(
            of.thresholds, of.low, of.high, step="post", color=style.colour, alpha=0.12, linewidth=0
        )
    ax.set(
        xlabel="normalised return τ", ylabel="share of trainings above τ", xlim=(0, 1.05), ylim=(-0.02, 1.02)
    )
    legend_below(figure, [ax])
    return figure


def overall_marks(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw the normalised mean of every complete row, with its interval."""
    found = overall(table, records)
    if not found:
        return None
    figure, [[ax]] = panels(1, 1, height=0.5 + 0.22 * len(found))
    figure.set_figwidth(2 * PANEL[0])
    for place, (mean, _) in enumerate(found.values()):
        colour = style_of("tree").colour if place == 0 else "#555555"
        _draw_interval(ax, place, mean, colour, "o")
    _name_rows(ax, [name_of(table, row) for row in found])
    figure.supxlabel(
        "normalised mean return, 95 % interval", fontsize="medium"
    )  # names leave the panel little room
    ax.set_xlim(min(0, ax.get_xlim()[0]), max(1.05, ax.get_xlim()[1]))
    return figure


def tree_sizes(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw the nodes of every training's tree, and their mean as a bar."""
    sizes = {cell: of.record.nodes for cell, of in summarise(table, records).items() if of.record.nodes}
    if not sizes:
        return None
    figure, [[ax]] = panels(1, 1, height=0.5 + 0.75 * len(table.environments))
    figure.set_figwidth(2 * PANEL[0])
    others, rows = _others(table), len(table.rows)
    for i, env in enumerate(table.environments):
        for j, row in enumerate(table.rows):
            nodes = sizes.get(cell_of(row, env))
            if nodes:
                style, place = style_of(row.method, others), i + 0.8 * (j + 0.5) / rows - 0.4
                ax.plot(
                    nodes,
                    [place] * len(nodes),
                    style.marker,
                    color=style.colour,
                    alpha=0.7,
                    label=name_of(table, row),
                )
                ax.plot([np.mean(nodes)], [place], "|", color="black", markersize=9, label="mean")
    _name_rows(ax, table.environments)
    ax.set(xlabel="nodes of the pruned tree (logarithmic)", xscale="log")
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    legend_below(figure, [ax])
    return figure


def losses(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw Cohen's d of every cell, with its interval; the scale is linear up to 1 and logarithmic beyond."""
    found = {cell: of.loss for cell, of in summarise(table, records).items() if of.loss is not None}
    if not found:
        return None
    figure, [[ax]] = panels(1, 1, height=0.5 + 0.75 * len(table.environments))
    figure.set_figwidth(2 * PANEL[0])
    others, rows, edge = _others(table), len(table.rows), 100.0
    ax.axvline(0, color="black", linewidth=0.8)
    for i, env in enumerate(table.environments):
        for j, row in enumerate(table.rows):
            d = found.get(cell_of(row, env))
            if d is not None:
                style, place = style_of(row.method, others), i + 0.8 * (j + 0.5) / rows - 0.4
                d = Interval(*np.clip(d, -edge, edge))
                _draw_interval(ax, place, d, style.colour, style.marker, name_of(table, row))
    _name_rows(ax, table.environments)
    ax.set_xscale("symlog", linthresh=1)
    ax.set(xlabel="Cohen's d, validation less test, 95 % interval", xlim=(-edge, edge))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    legend_below(figure, [ax])
    return figure


class Band(NamedTuple):
    """Validation returns over trainings, ``[timesteps]``; a single training has no standard deviation."""

    timesteps: np.ndarray
    mean: np.ndarray
    std: np.ndarray | None


def mean_and_std(record: Record) -> Band | None:
    """Return mean and standard deviation (ddof 1) over trainings, where all of them have a return.

    Trainings that were validated at other timesteps are interpolated linearly. None if there is no such timestep.
    """
    if not record.curves or not all(len(curve["timesteps"]) for curve in record.curves):
        return None
    first = max(curve["timesteps"][0] for curve in record.curves)
    last = min(curve["timesteps"][-1] for curve in record.curves)
    every = np.unique(np.concatenate([curve["timesteps"] for curve in record.curves]))
    steps = every[(every >= first) & (every <= last)]
    if not len(steps):
        return None
    returns = np.array([np.interp(steps, curve["timesteps"], curve["returns"]) for curve in record.curves])
    return Band(steps, returns.mean(axis=0), returns.std(axis=0, ddof=1) if len(returns) > 1 else None)


def training_curves(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw a panel for each environment: curves of all trained methods, and their test returns as dashed lines."""
    methods = [row.method for row in table.rows if method_or_label(row.method).teacher is None]
    if not any(records[cell].curves for cell in table.cells() if cell in records):
        return None
    columns = 3
    figure, axes = panels(-(-len(table.environments) // columns), columns)
    flat = [ax for row in axes for ax in row]
    for ax, env in zip(flat, table.environments, strict=False):
        for method in methods:
            _draw_curve(ax, records.get(Cell(env, "ppo", method)), method, methods)
        _finish_panel(ax, env)
    for ax in flat[len(table.environments) :]:
        ax.set_axis_off()
    legend_below(figure, flat)
    return figure


def pairwise_curves(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Draw a row for each environment and a column for each post-hoc tree, with SYMPOL's curve and its teacher's."""
    pairs = [method for method in PAIRED if any(row.method == method for row in table.rows)]
    cells = [Cell(env, "ppo", method) for env in table.environments for method in pairs]
    if not any(cell in records for cell in cells):
        return None
    figure, axes = panels(len(table.environments), len(pairs))
    for row, env in zip(axes, table.environments, strict=True):
        for ax, method in zip(row, pairs, strict=True):
            teacher = method_or_label(method).teacher or method
            _draw_curve(ax, records.get(Cell(env, "ppo", "tree")), "tree")
            _draw_curve(ax, records.get(Cell(env, "ppo", teacher)), teacher, test=False, suffix=" (teacher)")
            _draw_test_return(ax, records.get(Cell(env, "ppo", method)), method)
            _finish_panel(ax, f"{env}\nSYMPOL and {method_or_label(method).label}")
    legend_below(figure, [ax for row in axes for ax in row])
    return figure


def _draw_curve(
    ax: Axes,
    record: Record | None,
    method: str,
    others: Sequence[str] = (),
    *,
    test: bool = True,
    suffix: str = "",
) -> None:
    of = None if record is None else mean_and_std(record)
    if record is None or of is None:
        return
    colour = style_of(method, others).colour
    few = max(1, len(of.timesteps) // 6)
    marker = style_of(method, others).marker
    ax.plot(
        of.timesteps,
        of.mean,
        color=colour,
        marker=marker,
        markevery=few,
        label=method_or_label(method).label + suffix,
    )
    if of.std is not None:
        ax.fill_between(
            of.timesteps, of.mean - of.std, of.mean + of.std, color=colour, alpha=0.18, linewidth=0
        )
    if test:
        _draw_test_return(ax, record, method, others)


def _draw_test_return(ax: Axes, record: Record | None, method: str, others: Sequence[str] = ()) -> None:
    """Draw a dashed line at the mean test return."""
    if record is not None:
        mean = float(training_means(record.returns).mean())
        label = f"{method_or_label(method).label}, test"
        ax.axhline(
            mean, color=style_of(method, others).colour, linestyle=(0, (4, 2)), linewidth=1.1, label=label
        )


def _finish_panel(ax: Axes, title: str) -> None:
    ax.set_title(title)
    if not ax.lines:
        ax.text(0.5, 0.5, "not run", transform=ax.transAxes, ha="center", va="center", color="#666666")
        ax.set(xticks=[], yticks=[])
        return
    low, high = ax.get_ylim()
    room = 0.05 * (high - low)  # a line at the edge would be half a line
    ax.set(ylim=(low - room, high + room), xlabel="environment steps", ylabel="validation return")
    ax.xaxis.set_major_formatter(lambda value, _: count(value))


def _draw_interval(
    ax: Axes, place: float, of: Interval, colour: str, marker: str, label: str | None = None
) -> None:
    ax.plot([of.low, of.high], [place, place], color=colour, linewidth=1.2)
    ax.plot([of.estimate], [place], marker, color=colour, label=label)


def _name_rows(ax: Axes, names: list[str] | tuple[str, ...]) -> None:
    """Label rows with names, from the top down."""
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(axis="y", visible=False)
    for place in range(1, len(names)):
        ax.axhline(place - 0.5, color="#E5E5E5", linewidth=0.6)


def _others(table: Table) -> list[str]:
    """Return the methods that have no style of their own, in order."""
    return [method for method in dict.fromkeys(row.method for row in table.rows) if method not in METHODS]
