"""Curves of trainings: validation return against environment steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..results.number_format import count
from ..results.statistics import training_means
from ..results.style import legend_below, look, panels
from .methods import known
from .record import Cell, Record
from .tables import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAIRED = ("sa-dt-5", "sa-dt-8", "d-sdt")
"""Post-hoc trees that are drawn beside SYMPOL."""


class Band(NamedTuple):
    """Validation returns of some trainings, ``[timesteps]``; a single one has no standard deviation."""

    timesteps: np.ndarray
    mean: np.ndarray
    std: np.ndarray | None


def band(record: Record) -> Band | None:
    """Mean and standard deviation (ddof 1) over trainings, where all of them have a return.

    Trainings that were validated at other timesteps are interpolated linearly.
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
    """A panel an environment: curves of all methods that are trained, their test returns dashed at the end."""
    methods = [row.method for row in table.rows if known(row.method).teacher is None]
    if not any(records[cell].curves for cell in table.cells() if cell in records):
        return None
    columns = 3
    figure, axes = panels(-(-len(table.environments) // columns), columns)
    flat = [ax for row in axes for ax in row]
    for ax, env in zip(flat, table.environments, strict=False):
        for method in methods:
            _curve(ax, records.get(Cell(env, "ppo", method)), method, methods)
        _dress(ax, env)
    for ax in flat[len(table.environments) :]:
        ax.set_axis_off()
    legend_below(figure, flat)
    return figure


def pairwise_curves(table: Table, records: Mapping[Cell, Record]) -> Figure | None:
    """A row an environment, a column a post-hoc tree: SYMPOL's curve and its teacher's; test returns dashed."""
    pairs = [method for method in PAIRED if any(row.method == method for row in table.rows)]
    cells = [Cell(env, "ppo", method) for env in table.environments for method in pairs]
    if not any(cell in records for cell in cells):
        return None
    figure, axes = panels(len(table.environments), len(pairs))
    for row, env in zip(axes, table.environments, strict=True):
        for ax, method in zip(row, pairs, strict=True):
            teacher = known(method).teacher or method
            _curve(ax, records.get(Cell(env, "ppo", "tree")), "tree")
            _curve(ax, records.get(Cell(env, "ppo", teacher)), teacher, test=False, suffix=" (teacher)")
            _test(ax, records.get(Cell(env, "ppo", method)), method)
            _dress(ax, f"{env}\nSYMPOL and {known(method).label}")
    legend_below(figure, [ax for row in axes for ax in row])
    return figure


def _curve(
    ax: Axes,
    record: Record | None,
    method: str,
    others: Sequence[str] = (),
    *,
    test: bool = True,
    suffix: str = "",
) -> None:
    of = None if record is None else band(record)
    if record is None or of is None:
        return
    colour = look(method, others).colour
    few = max(1, len(of.timesteps) // 6)
    marker = look(method, others).marker
    ax.plot(
        of.timesteps, of.mean, color=colour, marker=marker, markevery=few, label=known(method).label + suffix
    )
    if of.std is not None:
        ax.fill_between(
            of.timesteps, of.mean - of.std, of.mean + of.std, color=colour, alpha=0.18, linewidth=0
        )
    if test:
        _test(ax, record, method, others)


def _test(ax: Axes, record: Record | None, method: str, others: Sequence[str] = ()) -> None:
    """A dashed line at the mean test return."""
    if record is not None:
        mean = float(training_means(record.returns).mean())
        label = f"{known(method).label}, test"
        ax.axhline(mean, color=look(method, others).colour, linestyle=(0, (4, 2)), linewidth=1.1, label=label)


def _dress(ax: Axes, title: str) -> None:
    ax.set_title(title)
    if not ax.lines:
        ax.text(0.5, 0.5, "not run", transform=ax.transAxes, ha="center", va="center", color="#666666")
        ax.set(xticks=[], yticks=[])
        return
    low, high = ax.get_ylim()
    room = 0.05 * (high - low)  # a line at the edge would be half a line
    ax.set(ylim=(low - room, high + room), xlabel="environment steps", ylabel="validation return")
    ax.xaxis.set_major_formatter(lambda value, _: count(value))
