"""Plots of records: performance profiles, sizes of trees, information lost, ablations; curves are in `curves`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..results.statistics import Interval, performance_profile
from ..results.style import PANEL, legend_below, look, panels, save, styled
from .curves import pairwise_curves, training_curves
from .grids import name_of
from .methods import METHODS
from .record import Cell, Record
from .summary import overall, scores, summarise
from .tables import Table, cell_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["figures", "save"]


def figures(table: Table, records: Mapping[Cell, Record]) -> dict[str, Figure]:
    """All plots that the table's records can fill, by name."""
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
    """Write all plots as ``<table>-<figure>.svg``."""
    folder.mkdir(parents=True, exist_ok=True)
    return [
        save(figure, folder / f"{table.name}-{name}{suffix}")
        for name, figure in figures(table, records).items()
    ]


def profiles(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Share of trainings above each normalised return, with pointwise 95 % bands, of all complete rows."""
    found = scores(table, records)
    if not found:
        return None
    figure, [[ax]] = panels(1, 1, height=1.5 * PANEL[1])
    figure.set_figwidth(2 * PANEL[0])
    thresholds, others = np.linspace(0, 1.05, 106), _others(table)
    for row, strata in found.items():
        of, style = performance_profile(strata, thresholds), look(row.method, others)
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
    """Normalised mean of every complete row, with its interval."""
    found = overall(table, records)
    if not found:
        return None
    figure, [[ax]] = panels(1, 1, height=0.5 + 0.22 * len(found))
    figure.set_figwidth(2 * PANEL[0])
    for place, (mean, _) in enumerate(found.values()):
        colour = look("tree").colour if place == 0 else "#555555"
        _mark(ax, place, mean, colour, "o")
    _name_rows(ax, [name_of(table, row) for row in found])
    figure.supxlabel(
        "normalised mean return, 95 % interval", fontsize="medium"
    )  # names leave the panel little room
    ax.set_xlim(min(0, ax.get_xlim()[0]), max(1.05, ax.get_xlim()[1]))
    return figure


def tree_sizes(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """Nodes of every training's tree, and their mean as a bar."""
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
                style, place = look(row.method, others), i + 0.8 * (j + 0.5) / rows - 0.4
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
    """Cohen's d of every cell, with its interval; the scale is linear up to 1 and logarithmic beyond."""
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
                style, place = look(row.method, others), i + 0.8 * (j + 0.5) / rows - 0.4
                d = Interval(*np.clip(d, -edge, edge))
                _mark(ax, place, d, style.colour, style.marker, name_of(table, row))
    _name_rows(ax, table.environments)
    ax.set_xscale("symlog", linthresh=1)
    ax.set(xlabel="Cohen's d, validation less test, 95 % interval", xlim=(-edge, edge))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    legend_below(figure, [ax])
    return figure


def _mark(ax: Axes, place: float, of: Interval, colour: str, marker: str, label: str | None = None) -> None:
    ax.plot([of.low, of.high], [place, place], color=colour, linewidth=1.2)
    ax.plot([of.estimate], [place], marker, color=colour, label=label)


def _name_rows(ax: Axes, names: list[str] | tuple[str, ...]) -> None:
    """One name a whole number, from the top down."""
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(axis="y", visible=False)
    for place in range(1, len(names)):
        ax.axhline(place - 0.5, color="#E5E5E5", linewidth=0.6)


def _others(table: Table) -> list[str]:
    """Methods without a look of their own, in order."""
    return [method for method in dict.fromkeys(row.method for row in table.rows) if method not in METHODS]
