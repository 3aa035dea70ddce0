"""Trees as pictures.

A small tree grows from the top down, its left branch where the answer is yes; one that would be too wide to read
on a page grows from left to right, its upper branch where the answer is yes. Colours are told apart by people who
do not tell red from green, and nothing is said by colour alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .actions import BoxActions, DiscreteActions
from .floats import number, printable
from .layout import levels, tidy
from .text import leaf_words, visit_share
from .tree import DecisionTree

if TYPE_CHECKING:
    from jaxtyping import Float
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_NODES = 2000

# Okabe and Ito's colours, those that lie furthest apart first
_COLOURS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#D55E00", "#0072B2", "#999999")
_DIVERGING, _SEQUENTIAL = "RdBu_r", "cividis"
_INK, _LINE, _PAPER = "#222222", "#8C8C8C", "#FFFFFF"

# inches, on paper
_PAGE = (10.0, 7.0)
_ROW, _PAD, _MARGIN = 0.17, 0.09, 0.15
_FONT_SIZE = 9.0  # points
_LONGEST_LABEL = 40  # characters

_METADATA: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "sympol",  # the same tree, the same file
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "text.usetex": False,
    "path.sketch": None,
}


@dataclass(frozen=True)
class _Label:
    """Rows of a node's box, each with its own colour."""

    rows: tuple[str, ...]
    colours: tuple[str, ...]


@dataclass(frozen=True)
class _Layout:
    """Centres and sizes of all boxes [nodes, 2], in inches from the upper left corner."""

    centre: Float[np.ndarray, "nodes 2"]
    size: Float[np.ndarray, "nodes 2"]
    downward: bool

    @property
    def extent(self) -> Float[np.ndarray, " 2"]:
        """Width and height of the picture."""
        return (self.centre + self.size / 2).max(axis=0) + _MARGIN


def plot(
    tree: DecisionTree, path: str | PathLike[str] | None = None, *, ax: Axes | None = None, digits: int = 4
) -> Figure:
    """Draw the tree on ``ax``, or on a figure of its own size, and save it if a path is given.

    Thresholds have ``digits`` significant digits; `to_text` writes them exactly. Lines are as thick as the
    share of visits that went along, where visits are known.

    Raises:
        ValueError: if the path ends neither in .svg, .pdf nor .png, or the tree is too large to look at.
    """
    suffix = Path(path).suffix.lower() if path is not None else ".svg"
    if suffix not in _METADATA:
        raise ValueError(f"a plot is saved as .svg, .pdf or .png, got {str(path)!r}")
    if tree.n_nodes > MOST_NODES:
        raise ValueError(f"at most {MOST_NODES} nodes can be drawn, got {tree.n_nodes}; prune the tree first")
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        layout, labels = _arrange(tree, digits)
        if ax is None:
            ax = Figure(figsize=tuple(layout.extent)).add_axes((0, 0, 1, 1))
        figure = ax.figure.canvas.figure  # the whole one, also where ax is on a part of it
        _draw(tree, layout, labels, ax)
        if path is not None:
            dpi = min(200.0, 20_000 / max(figure.get_size_inches()))
            figure.savefig(path, dpi=dpi, metadata=_METADATA[suffix])
    return figure


def _arrange(tree: DecisionTree, digits: int) -> tuple[_Layout, list[_Label]]:
    """Lay the tree out downward if that can be read on a page, and else to the right if that is better."""
    downward, down_labels = _laid_out(tree, digits, downward=True)
    rightward, right_labels = _laid_out(tree, digits, downward=False)

    def scale_on_page(layout: _Layout) -> float:
        return min(1.0, float(np.min(np.sort(_PAGE) / np.sort(layout.extent))))

    if scale_on_page(downward) >= min(0.8, scale_on_page(rightward)):
        return downward, down_labels
    return rightward, right_labels


def _laid_out(tree: DecisionTree, digits: int, *, downward: bool) -> tuple[_Layout, list[_Label]]:
    labels = _labels(tree, digits, downward=downward)
    width = np.array([max(map(_text_width, label.rows)) + 2 * _PAD for label in labels])
    height = np.array([len(label.rows) * _ROW + _PAD for label in labels])
    if downward:
        x, y = tidy(tree, width, gap=0.12), levels(tree, height, gap=0.45)
    else:
        x, y = levels(tree, width, gap=0.55), tidy(tree, height, gap=0.07)
    centre, size = np.stack([x, y], axis=1) + _MARGIN, np.stack([width, height], axis=1)
    return _Layout(centre, size, downward), labels


def _labels(tree: DecisionTree, digits: int, *, downward: bool) -> list[_Label]:
    """Word and colour every node; a leaf's share of visits goes where there is room: below, or behind."""
    colour = _leaf_colours(tree)
    labels = []
    for node in range(tree.n_nodes):
        if tree.is_leaf[node]:
            rows = tuple(map(_shortened, leaf_words(tree, node, digits)))
            share = visit_share(tree, node)
            colours = colour[node]
            if share and downward:
                # where a row has a component's colour, the share belongs to none of them
                rows, colours = (*rows, share), (*colours, colours[0] if len(rows) == 1 else _PAPER)
            elif share:
                rows = (*rows[:-1], f"{rows[-1]}   {share}")
            labels.append(_Label(rows, colours))
        else:
            name = _shortened(printable(tree.feature_names[tree.feature[node]]))
            question = f"≤ {number(tree.threshold[node], digits)}"
            labels.append(_Label((name, question), (_PAPER, _PAPER)))
    return labels


def _leaf_colours(tree: DecisionTree) -> list[tuple[str, ...]]:
    """Return a colour for each component of each node's action."""
    actions = tree.actions
    decided = actions.decide(tree.value).reshape(tree.n_nodes, -1)
    if not isinstance(actions, BoxActions):
        start = actions.start if isinstance(actions, DiscreteActions) else np.array(actions.start)
        return [tuple(_COLOURS[i % len(_COLOURS)] for i in row) for row in (decided - start).tolist()]

    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    answers = decided[tree.is_leaf]
    low = np.where(np.isfinite(actions.low), actions.low, answers.min(axis=0))
    high = np.where(np.isfinite(actions.high), actions.high, answers.max(axis=0))
    signed = (low < 0) & (high > 0)
    # around zero where the action has two directions, from end to end where it has one
    reach = np.maximum(np.abs(low), np.abs(high))
    low, high = np.where(signed, -reach, low), np.where(signed, reach, high)
    share = (decided - low) / np.where(high > low, high - low, 1)
    maps = [colormaps[_DIVERGING if two_sided else _SEQUENTIAL] for two_sided in signed]
    # the ends of a map are too dark to write on
    return [tuple(to_hex(m(0.1 + 0.8 * s)) for m, s in zip(maps, row, strict=True)) for row in share.tolist()]


def _shortened(words: str) -> str:
    return words if len(words) <= _LONGEST_LABEL else words[: _LONGEST_LABEL - 1] + "…"


def _text_width(words: str) -> float:
    """Return how wide the words will be, in inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=_FONT_SIZE)
    width, _, _ = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    return width / 72


def _draw(tree: DecisionTree, layout: _Layout, labels: list[_Label], ax: Axes) -> None:
    """Draw on axes whose unit is an inch, if they are as large as the layout; else everything scales."""
    extent = layout.extent
    ax.set_axis_off()
    ax.set(xlim=(0, extent[0]), ylim=(extent[1], 0), aspect="equal")
    available = np.array(ax.get_window_extent().size) / ax.figure.dpi
    scale = float(np.min(available / extent))
    for node in np.flatnonzero(~tree.is_leaf):
        _draw_edge(tree, layout, ax, scale, int(node), int(tree.children_left[node]), "yes")
        _draw_edge(tree, layout, ax, scale, int(node), int(tree.children_right[node]), "no")
    for node, label in enumerate(labels):
        _draw_box(layout.centre[node], layout.size[node], label, ax, scale)


def _draw_edge(
    tree: DecisionTree, layout: _Layout, ax: Axes, scale: float, parent: int, child: int, answer: str
) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    along = 1 if layout.downward else 0
    ahead = np.eye(2)[along]
    start = layout.centre[parent] + ahead * layout.size[parent] / 2
    end = layout.centre[child] - ahead * layout.size[child] / 2
    bend = ahead * (end - start) / 2
    visits = tree.n_node_samples
    share = visits[child] / visits[0] if visits is not None and visits[0] else 0.1
    curve = Curve([start, start + bend, end - bend, end], [Curve.MOVETO, *[Curve.CURVE4] * 3])
    ax.add_patch(PathPatch(curve, fill=False, edgecolor=_LINE, linewidth=(0.6 + 5 * share) * scale, zorder=1))
    x, y = start * 0.4 + end * 0.6
    ax.text(
        x,
        y,
        answer,
        size=0.75 * _FONT_SIZE * scale,
        color=_INK,
        ha="center",
        va="center",
        bbox={"facecolor": _PAPER, "edgecolor": "none", "pad": 0.6 * scale, "alpha": 0.85},
        zorder=2,
    )


def _draw_box(centre: np.ndarray, size: np.ndarray, label: _Label, ax: Axes, scale: float) -> None:
    from matplotlib.patches import FancyBboxPatch, Rectangle

    (x, y), (width, height) = centre - size / 2, size

    def rounded(top: float, **look: Any) -> FancyBboxPatch:
        return FancyBboxPatch(
            (x, y + top), width, height - top, boxstyle="round,pad=0,rounding_size=0.06", **look
        )

    ax.add_patch(rounded(0, facecolor="none", edgecolor=_LINE, linewidth=0.8 * scale, zorder=4))
    for row, (words, colour) in enumerate(zip(label.rows, label.colours, strict=True)):
        # each row paints down to the bottom, and the next one over it
        top = _PAD / 2 + row * _ROW if row else 0
        ax.add_patch(rounded(top, facecolor=colour, edgecolor="none", zorder=3))
        if row:
            ax.add_patch(
                Rectangle((x, y + top), width, _ROW / 2, facecolor=colour, edgecolor="none", zorder=3)
            )
        ax.text(
            centre[0],
            y + _PAD / 2 + (row + 0.5) * _ROW,
            words,
            size=_FONT_SIZE * scale,
            color=_readable_on(colour),
            ha="center",
            va="center_baseline",
            parse_math=False,
            zorder=5,
        )


def _readable_on(colour: str) -> str:
    """Return black or white, whichever stands out more."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return _INK if 0.299 * red + 0.587 * green + 0.114 * blue > 130 else _PAPER
