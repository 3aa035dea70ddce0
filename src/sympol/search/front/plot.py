"""The front as a picture: validation return against nodes, and the trees themselves beside it.

A method has a colour and a mark, so that nothing is shown by colour alone. The same front gives the same file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from ...results.formatting import as_printed, number
from ...results.style import PANEL, LineStyle, legend_below, save, styled
from ...runs.formatting import decimals
from ...trees.plot import arrange, draw
from ...trees.plot_style import check_file
from .front import Front, Point, best_under_sizes, require_one_task, sizes_of
from .labels import Label, place_labels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Looks: TypeAlias = Mapping[str, LineStyle]
"""The colour and the mark of each method."""


class Reference(NamedTuple):
    """A return reported elsewhere, drawn beside a front."""

    label: str
    mean: float
    nodes: float | None = None
    """The number of nodes; None for a policy that is no tree."""


_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKS = ("o", "^", "s", "D", "v", "P", "X", "p")
_GREY = "#777777"
SIZE = (2.3 * PANEL[0], 1.75 * PANEL[1])
_LETTER = 0.07
"""The width of a letter in a legend, in inches."""
_MIN_AXIS = 15
"""The number of nodes that the axis reaches at least."""


def plot(
    fronts: Front | Sequence[Front],
    path: str | PathLike[str] | None = None,
    *,
    beside: Sequence[Reference] = (),
) -> Figure:
    """Draw the front of one run, or those of several runs of one task with their mean.

    Args:
        fronts: The front of one run, or those of several.
        path: Where to save the picture: a .svg, .pdf or .png file. By default it is not saved.
        beside: Returns reported elsewhere.

    Returns:
        The figure.

    Raises:
        ValueError: The path has another ending, or the runs are not of one task.
    """
    fronts = [fronts] if isinstance(fronts, Front) else list(fronts)
    if path is not None:
        check_file(path)
    with styled():
        from matplotlib.figure import Figure

        figure = Figure(figsize=SIZE, layout="constrained")
        ax = figure.subplots()
        labels = panel(ax, fronts, looks_of(fronts), beside)
        add_legend(figure, [ax])
        fix_panels(figure)
        place_labels(ax, labels)
        if path is not None:
            save(figure, Path(path))
    return figure


def add_legend(figure: Figure, axes: Sequence[Axes]) -> None:
    """Put one legend below all panels, in as many columns as there is room for.

    Args:
        figure: The figure.
        axes: Its panels.
    """
    longest = max(len(label) for ax in axes for label in ax.get_legend_handles_labels()[1])
    legend_below(figure, axes, columns=max(1, int(figure.get_figwidth() / (0.7 + _LETTER * longest))))


def fix_panels(figure: Figure) -> None:
    """Fix the positions of the panels, rounded: the layout solver's last digits differ from run to run.

    Args:
        figure: The figure, with all its panels.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for ax in figure.axes:
        left, bottom, width, height = np.round(ax.get_position().bounds, 4).tolist()
        ax.set_position((left, bottom, width, height))


def draw_tree(ax: Axes, point: Point) -> None:
    """Draw the tree of a point in the middle of a panel, no larger than on a page of its own.

    Args:
        ax: The panel.
        point: The point.
    """
    layout, boxes = arrange(point.tree, 3)
    figure = ax.figure.canvas.figure
    place, wanted = ax.get_position(), layout.extent / figure.get_size_inches()
    width, height = np.minimum(wanted, (place.width, place.height)).tolist()
    left, bottom = place.x0 + (place.width - width) / 2, place.y0 + (place.height - height) / 2
    ax.set_position((left, bottom, width, height))
    draw(point.tree, layout, boxes, ax)


def looks_of(fronts: Iterable[Front]) -> Looks:
    """Return a look for every method, the same whenever the methods are the same.

    Args:
        fronts: The fronts that are drawn.

    Returns:
        A colour and a mark for each of their methods.
    """
    methods = sorted({mark.method for front in fronts for mark in (*front.points, *front.candidates)})
    styles = zip(methods, cycle(_COLOURS), cycle(_MARKS), strict=False)
    return {method: LineStyle(colour, "-", mark) for method, colour, mark in styles}


def panel(ax: Axes, fronts: Sequence[Front], looks: Looks, beside: Sequence[Reference] = ()) -> list[Label]:
    """Draw the fronts of one task.

    Args:
        ax: The panel.
        fronts: The fronts of one run or of several.
        looks: The look of each method.
        beside: Returns reported elsewhere.

    Returns:
        Labels for `place_labels`, which puts them where there is room.
    """
    environment = require_one_task(fronts)
    right = _nodes_axis(ax, fronts, beside)
    bottom = _returns_axis(ax, fronts, beside)
    for front in fronts:
        _candidates(ax, front, looks)
        _steps(ax, front.points, right, faint=len(fronts) > 1)
        for point in front.points:
            _point(ax, point, looks[point.method], bottom)
    if len(fronts) > 1:
        _mean(ax, fronts, right)
    else:
        _tests(ax, fronts[0])
    ax.set(title=environment, xlabel="nodes", ylabel="validation return" if len(fronts) == 1 else "return")
    return [*_below(fronts, bottom), *_references(ax, beside)]


def _nodes_axis(ax: Axes, fronts: Sequence[Front], others: Iterable[Reference]) -> float:
    """Set up an axis with one step for each level of depth: 1, 3, 7, 15, …; return its end."""
    most = max([_MIN_AXIS, *sizes_of(fronts), *(other.nodes or 0 for other in others)])
    last = int(np.ceil(np.log2(most + 1)))
    ax.set_xscale("function", functions=(lambda n: np.log2(np.maximum(n, 0) + 1), lambda x: 2.0**x - 1))
    ticks = [2**k - 1 for k in range(1, last + 1)]
    ax.set_xticks(ticks, [str(tick) for tick in ticks])
    ax.minorticks_off()
    right = 2 ** (last + 0.3) - 1
    ax.set_xlim(2**0.7 - 1, right)
    return right


def _returns_axis(ax: Axes, fronts: Sequence[Front], others: Sequence[Reference]) -> float:
    """Set limits between which good trees can be told apart; return the lower one. Points below it become labels."""
    means = np.array([point.mean for front in fronts for point in front.points])
    top = max(means.max(), *(point.validation.high for front in fronts for point in front.points))
    shown = [other.mean for other in others]
    top, middle = max([top, *shown]), float(np.median(means))
    bottom = min([max(means.min(), top - 3 * (top - middle)), *shown])
    room = 0.08 * ((top - bottom) or max(1.0, abs(top)))
    ax.set_ylim(bottom - room, top + room)
    ax.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    return bottom - room


def _candidates(ax: Axes, front: Front, looks: Looks) -> None:
    for method in dict.fromkeys(candidate.method for candidate in front.candidates):
        tried = [
            (candidate.nodes, candidate.mean) for candidate in front.candidates if candidate.method == method
        ]
        look = looks[method]
        ax.plot(*np.transpose(tried), look.marker, color=look.colour, alpha=0.15, markersize=3)


def _steps(ax: Axes, points: Sequence[Point], right: float, *, faint: bool) -> None:
    """Draw the best return within each number of nodes."""
    nodes, means = stairs([point.nodes for point in points], [point.mean for point in points], right)
    ax.plot(nodes, means, color=_GREY, linewidth=0.6 if faint else 1.2)


def stairs(nodes: Sequence[int], values: Sequence[float], right: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of a line that keeps each value until the next size.

    Args:
        nodes: The sizes ``[n]``, ascending.
        values: The value of each ``[n]``.
        right: Where the last value ends.

    Returns:
        The sizes and values of the corners, ``[2 n]`` each.
    """
    return np.repeat([*nodes, right], 2)[1:-1], np.repeat(values, 2)


def _point(ax: Axes, point: Point, look: LineStyle, bottom: float) -> None:
    if point.mean < bottom:
        return
    low, high = point.interval
    ax.plot([point.nodes] * 2, [low, high], color=look.colour, linewidth=1.2)
    ax.plot([point.nodes], [point.mean], look.marker, color=look.colour, label=point.method)


def _tests(ax: Axes, front: Front) -> None:
    tested = [(point.nodes, point.test.mean) for point in front.points if point.test is not None]
    if tested:
        ax.plot(*np.transpose(tested), "_", color="black", markersize=8, label="test")


def _mean(ax: Axes, fronts: Sequence[Front], right: float) -> None:
    """Draw the mean test return over runs, with its interval over runs."""
    if any(point.test is None for front in fronts for point in front.points):
        return
    rows = [row for row in best_under_sizes(fronts, sizes_of(fronts)) if row.spread is not None]
    nodes = [row.nodes for row in rows]
    mean, low, high = (
        stairs(nodes, [getattr(row.spread, name) for row in rows], right)[1]
        for name in ("estimate", "low", "high")
    )
    across = stairs(nodes, nodes, right)[0]
    ax.plot(across, mean, color="black", label="test: mean of runs, 95 %", zorder=3)
    ax.fill_between(across, low, high, color="black", alpha=0.08, linewidth=0)


def _below(fronts: Sequence[Front], bottom: float) -> list[Label]:
    """Return labels at the lower edge for points that lie below it."""
    low = [point for front in fronts for point in front.points if point.mean < bottom]
    worst = {point.nodes: point for point in sorted(low, key=lambda point: -point.mean)}
    return [Label(nodes, bottom, f"↓ {_short(point.mean)}", _GREY) for nodes, point in worst.items()]


def _references(ax: Axes, others: Iterable[Reference]) -> list[Label]:
    """Draw trees as crosses and other policies as lines across; return their labels."""
    labels = []
    for other in others:
        if other.nodes is None:
            ax.axhline(other.mean, color=_GREY, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
        else:
            ax.plot([other.nodes], [other.mean], "+", color="black", markersize=6)
        text, colour = f"{other.label} {as_printed(other.mean)}", "black" if other.nodes else _GREY
        labels.append(Label(other.nodes, other.mean, text, colour))
    return labels


def _short(mean: float) -> str:
    return number(mean, 0 if float(mean).is_integer() else decimals(mean))
