"""Soft decision trees as pictures: oblique nodes as bars, leaves as distributions.

The layout, the lines and the colours are those of hard trees (`sympol.trees.plot`), so that the two can be set beside
each other. A line is as thick as the share of the weight that goes along it, where shares are known.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from ..trees import DecisionTree
from ..trees.plot import arrange, draw
from ..trees.plot_boxes import FONT_SIZE, INK
from ..trees.plot_layout import Drawable, Layout, lay_out
from ..trees.plot_style import check_file, drawn_in, save, style_for
from .picture_boxes import boxes_of
from .soft_text import legend
from .soft_view import SoftView, in_preorder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEEPEST = 8
_LINE = 0.16  # inches from a line of the legend to the next
_PER_INCH = 19.0  # characters of the legend
_GAP = 0.5  # between two trees


def plot_soft_tree(view: SoftView, path: str | PathLike[str] | None = None, *, digits: int = 3) -> Figure:
    """Draw a soft tree, with an explanation below, and save it if a path is given.

    A node lists its features by weight, each with a bar from 0 to 1, and compares their sum with its threshold; the
    features are scaled. A leaf shows what it would choose by itself.

    Args:
        view: The soft tree.
        path: The file to write.
        digits: The number of significant digits.

    Returns:
        The figure.

    Raises:
        ValueError: The path ends neither in .svg, .pdf nor .png, or the tree is too deep to look at.
    """
    layout, boxes, skeleton, style = _arranged(view, path, digits)
    reading = _reading(view, max(layout.extent[0], 6.0))
    return _on_one_page([("", skeleton, layout, boxes)], reading, path, style)


def plot_beside(
    view: SoftView, tree: DecisionTree, path: str | PathLike[str] | None = None, *, digits: int = 3
) -> Figure:
    """Draw a soft tree and, on its right, a hard one of the same environment.

    Args:
        view: The soft tree.
        tree: The hard tree.
        path: The file to write.
        digits: The number of significant digits.

    Returns:
        The figure.

    Raises:
        ValueError: The path ends neither in .svg, .pdf nor .png, or a tree is too deep to look at.
    """
    layout, boxes, skeleton, style = _arranged(view, path, digits)
    hard, hard_boxes = arrange(tree, digits)
    parts = [("Soft decision tree", skeleton, layout, boxes), ("Hard decision tree", tree, hard, hard_boxes)]
    more = "The hard tree compares features as they are; each observation takes one way, and percentages count visits."
    return _on_one_page(parts, _reading(view, layout.extent[0] + hard.extent[0] + _GAP, more), path, style)


def _arranged(
    view: SoftView, path: str | PathLike[str] | None, digits: int
) -> tuple[Layout, Sequence[Drawable], DecisionTree, dict[Any, Any]]:
    if path is not None:
        check_file(path)
    depth = len(view.thresholds).bit_length()
    if depth > DEEPEST:
        raise ValueError(
            f"a soft tree of depth {DEEPEST} at most can be drawn, got one of {depth} with {2**depth - 1} nodes; read "
            "it as text, or make it hard: sympol distill --method discretize"
        )
    skeleton, order = view.skeleton(), in_preorder(len(view.thresholds))

    def boxes_when(downward: bool) -> Sequence[Drawable]:
        boxes = boxes_of(view, skeleton, digits, downward=downward)
        return [boxes[node] for node in order]

    style = style_for(skeleton)
    with drawn_in(style):  # the fonts decide how wide boxes are
        return *lay_out(skeleton, boxes_when), skeleton, style


def _reading(view: SoftView, width: float, more: str = "") -> list[str]:
    lines = legend(view)
    lines.insert(1, "Bars: the weights of a node's features, which sum to one; Σ is their weighted sum.")
    if view.shares is not None:
        lines.append("Ø and the lines' thickness: the mean weight over test episodes.")
    return textwrap.wrap(" ".join([*lines, more]), int(width * _PER_INCH))


def _on_one_page(
    parts: Sequence[tuple[str, DecisionTree, Layout, Sequence[Drawable]]],
    reading: Sequence[str],
    path: str | PathLike[str] | None,
    style: dict[Any, Any],
) -> Figure:
    """Trees from left to right, all at the same scale, under their titles; below them lines of small print."""
    from matplotlib.figure import Figure

    extents = np.array([layout.extent for _, _, layout, _ in parts])
    above = 0.35 if parts[0][0] else 0.0
    below = _LINE * (len(reading) + 1)
    width = max(float(extents[:, 0].sum()) + _GAP * (len(parts) - 1), 6.0)
    height = above + float(extents[:, 1].max()) + below
    with drawn_in(style):
        figure = Figure(figsize=(width, height))
        left = (width - float(extents[:, 0].sum()) - _GAP * (len(parts) - 1)) / 2
        for (title, tree, layout, boxes), (wide, high) in zip(parts, extents.tolist(), strict=True):
            bottom = height - above - high
            ax = figure.add_axes((left / width, bottom / height, wide / width, high / height))
            draw(tree, layout, boxes, ax)
            figure.text((left + wide / 2) / width, 1 - 0.22 / height, title, size=12, color=INK, ha="center")
            left += wide + _GAP
        for i, line in enumerate(reading):
            y = (below - _LINE * (i + 0.5)) / height
            figure.text(0.15 / width, y, line, size=0.8 * FONT_SIZE, color=INK, va="center", parse_math=False)
        if path is not None:
            save(figure, path)
    return figure
