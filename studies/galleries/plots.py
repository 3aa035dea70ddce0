"""A picture of all fronts, with published returns beside them and their smallest trees."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from matplotlib.figure import Figure

from sympol.results.formatting import number
from sympol.results.style import PANEL, save, styled
from sympol.runs.formatting import decimals
from sympol.search.front.front import Front, Point
from sympol.search.front.labels import place_labels
from sympol.search.front.plot import SIZE, add_legend, draw_tree, fix_panels, looks_of, panel
from sympol.trees.plot_style import check_file

from .published import published

_DRAWN = 15
"""Nodes of the largest tree that is drawn beside a front."""


def plot_gallery(
    tasks: Sequence[Sequence[Front]], path: str | PathLike[str] | None = None, *, trees: int = 3
) -> Figure:
    """Draw a row for each task: the front of its runs, and beside it the smallest ``trees`` trees of the first run.

    Raises:
        ValueError: There are no tasks, or as `sympol.search.front.plot.plot` does.
    """
    if not tasks:
        raise ValueError("a gallery needs the fronts of at least one task, got none")
    if path is not None:
        check_file(path)
    looks = looks_of([front for fronts in tasks for front in fronts])
    with styled():
        figure = Figure(
            figsize=(SIZE[0] + 1.1 * trees * PANEL[0], 1.35 * PANEL[1] * len(tasks)), layout="constrained"
        )
        widths = [SIZE[0] / PANEL[0], *[1.1] * trees]
        rows = figure.subplots(len(tasks), 1 + trees, squeeze=False, width_ratios=widths)
        panels = [
            (row[0], panel(row[0], fronts, looks, published(fronts[0].environment)))
            for row, fronts in zip(rows, tasks, strict=True)
        ]
        add_legend(figure, [ax for ax, _ in panels])
        beside = [
            (ax, point)
            for row, fronts in zip(rows, tasks, strict=True)
            for ax, point in zip(row[1:], smallest(fronts[0], trees), strict=False)
        ]
        for ax in rows[:, 1:].flat:
            ax.set_axis_off()
        for ax, point in beside:
            ax.set_title(f"{point.nodes} nodes: {_test_return(point)}")
        fix_panels(figure)  # a tree is drawn to fit its panel, whose place must be known
        for ax, point in beside:
            draw_tree(ax, point)
        for ax, labels in panels:
            place_labels(ax, labels)
        if path is not None:
            save(figure, Path(path))
    return figure


def smallest(front: Front, count: int) -> list[Point]:
    """Return the smallest trees of a front that have a split and can still be read."""
    return [point for point in front.points if 1 < point.nodes <= _DRAWN][:count]


def _test_return(point: Point) -> str:
    mean = point.mean if point.test is None else point.test.mean
    return number(mean, decimals(mean))
