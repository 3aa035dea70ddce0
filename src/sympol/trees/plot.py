"""Pictures of trees.

A small tree grows from the top down, its left branch where the answer is yes; one that would be too wide to read
on a page grows from left to right, its upper branch where the answer is yes. Colours are told apart by people who
do not tell red from green, and nothing is said by colour alone.

Where a tree asks what lies in a cell of what an agent sees, it is drawn as that view (`plot_view`).
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from .actions import BoxActions, DiscreteActions
from .base import BaseTree
from .floats import number, printable
from .plot_boxes import FONT_SIZE, INK, LINE, PAPER, Pen, TextBox, shortened
from .plot_grid_view import ViewBox, view_side
from .plot_layout import Drawable, Layout, lay_out
from .plot_style import check_file, drawn_in, save, style_for
from .text import asked_group, leaf_words, question, visit_share

if TYPE_CHECKING:
    from jaxtyping import Bool, UInt8
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

MOST_NODES = 2000

# Okabe and Ito's colours, those that lie furthest apart first
COLOURS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#D55E00", "#0072B2", "#999999")
_DIVERGING, _SEQUENTIAL = "RdBu_r", "cividis"
_ARROWS = {"turn left": "↰", "turn right": "↱", "forward": "↑", "move forward": "↑"}
"""Said beside the words where a tree is drawn with views, in which up is where the agent looks."""
_LEAST_DPI = 30.0
"""Fonts are not drawn smaller; the picture is made smaller instead."""

Box: TypeAlias = TextBox | ViewBox


def plot(
    tree: BaseTree,
    path: str | PathLike[str] | None = None,
    *,
    ax: Axes | None = None,
    digits: int = 4,
    highlight: ArrayLike | None = None,
) -> Figure:
    """Draw the tree on ``ax``, or on a figure of its own size, and save it if a path is given.

    Thresholds have ``digits`` significant digits; `to_text` writes them exactly. Lines are as thick as the
    share of visits that went along, where visits are known. ``highlight`` is an observation [features]: the
    way it goes stands out, and everything else is pale. Characters that are in no font of this machine become boxes,
    of which a warning is given.

    Raises:
        ValueError: if the path ends neither in .svg, .pdf nor .png, or the tree is too large to look at, or
            ``highlight`` is not one observation.
    """
    if path is not None:
        check_file(path)
    if tree.n_nodes > MOST_NODES:
        raise ValueError(f"at most {MOST_NODES} nodes can be drawn, got {tree.n_nodes}; prune the tree first")
    lit = None if highlight is None else tree.decision_path(highlight)
    if lit is not None and lit.ndim != 1:
        raise ValueError(f"highlight must be one observation, got {len(lit)} of them")
    from matplotlib.figure import Figure

    with drawn_in(style_for(tree)):
        layout, boxes = arrange(tree, digits)
        if ax is None:
            ax = Figure(figsize=tuple(layout.extent)).add_axes((0, 0, 1, 1))
        figure = ax.figure.canvas.figure  # the whole one, also where ax is on a part of it
        draw(tree, layout, boxes, ax, lit)
        if path is not None:
            save(figure, path)
    return figure


def arrange(tree: BaseTree, digits: int) -> tuple[Layout, list[Box]]:
    """Return the layout and the boxes of a drawn tree, with ``digits`` significant digits of thresholds."""
    yes_is_right = np.array(
        [not leaf and asked_group(tree, i) is not None for i, leaf in enumerate(tree.is_leaf)]
    )
    return lay_out(tree, lambda downward: _boxes(tree, digits, downward=downward), yes_is_right)


def _boxes(tree: BaseTree, digits: int, *, downward: bool) -> list[Box]:
    """Return a box for every node; the share of visits of a leaf goes below its action, or behind it."""
    colour, side = leaf_colours(tree), view_side(tree.groups)
    boxes: list[Box] = []
    for node in range(tree.n_nodes):
        if not tree.is_leaf[node]:
            boxes.append(_question_box(tree, node, digits, side))
            continue
        words = leaf_words(tree, node, digits)
        if side:
            words = tuple(f"{_ARROWS[w.casefold()]} {w}" if w.casefold() in _ARROWS else w for w in words)
        rows, colours = tuple(map(shortened, words)), colour[node]
        share = visit_share(tree, node)
        if share and downward:
            # where a row has a component's colour, the share belongs to none of them
            rows, colours = (*rows, share), (*colours, colours[0] if len(rows) == 1 else PAPER)
        elif share:
            rows = (*rows[:-1], f"{rows[-1]}   {share}")
        boxes.append(TextBox(rows, colours))
    return boxes


def _question_box(tree: BaseTree, node: int, digits: int, side: int) -> Box:
    feature, group = int(tree.feature[node]), asked_group(tree, node)
    if group is None:
        name = shortened(printable(tree.feature_names[feature]))
        return TextBox((name, f"≤ {number(tree.threshold[node], digits)}"), (PAPER, PAPER))
    words = question(tree, node, digits).words
    if group.cell is None:
        return TextBox((shortened(words),), (PAPER,))
    return ViewBox(side, group.cell, group.categories[group.features.index(feature)], words)


def leaf_colours(tree: BaseTree) -> list[tuple[str, ...]]:
    """Return a colour for each component of each node's action."""
    actions = tree.actions
    decided = tree.leaf_actions.reshape(tree.n_nodes, -1)
    if not isinstance(actions, BoxActions):
        start = actions.start if isinstance(actions, DiscreteActions) else np.array(actions.start)
        return [tuple(COLOURS[i % len(COLOURS)] for i in row) for row in (decided - start).tolist()]

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


def draw(
    tree: BaseTree,
    layout: Layout,
    boxes: Sequence[Drawable],
    ax: Axes,
    lit: Bool[np.ndarray, " nodes"] | None = None,
    *,
    only_lit: bool = False,
) -> None:
    """Draw on axes whose unit is an inch, if they are as large as the layout; else everything scales.

    The nodes in ``lit`` stand out and the others are pale, or left out.
    """
    extent = layout.extent
    ax.set_axis_off()
    ax.set(xlim=(0, extent[0]), ylim=(extent[1], 0), aspect="equal")
    available = np.array(ax.get_window_extent().size) / ax.figure.dpi
    scale = float(np.min(available / extent))
    shown = lit if only_lit and lit is not None else np.ones(tree.n_nodes, bool)
    pens = [Pen(ax, scale, None if lit is None else bool(lit[node])) for node in range(tree.n_nodes)]
    for node in np.flatnonzero(~tree.is_leaf & shown):
        asked = question(tree, int(node))
        for child, answer in ((asked.yes_child, "yes"), (asked.no_child, "no")):
            if shown[child]:
                _draw_edge(tree, layout, pens[child], int(node), child, answer)  # lit as the child is
    for node in np.flatnonzero(shown):
        boxes[int(node)].draw(pens[int(node)], layout.centre[node])


def _draw_edge(tree: BaseTree, layout: Layout, pen: Pen, parent: int, child: int, answer: str) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Curve

    along = 1 if layout.downward else 0
    ahead = np.eye(2)[along]
    start = layout.centre[parent] + ahead * layout.size[parent] / 2
    end = layout.centre[child] - ahead * layout.size[child] / 2
    bend = ahead * (end - start) / 2
    visits = tree.n_node_samples
    share = visits[child] / visits[0] if visits is not None and visits[0] else 0.1
    width = 3.0 if pen.lit else 0.6 + 5 * share
    pen.ax.add_patch(
        PathPatch(
            Curve([start, start + bend, end - bend, end], [Curve.MOVETO, *[Curve.CURVE4] * 3]),
            fill=False,
            edgecolor=pen.colour(INK if pen.lit else LINE),
            linewidth=width * pen.scale,
            zorder=1.5 if pen.lit else 1,
        )
    )
    x, y = start * 0.4 + end * 0.6
    pen.ax.text(
        x,
        y,
        answer,
        size=0.75 * FONT_SIZE * pen.scale,
        color=pen.colour(INK),
        ha="center",
        va="center",
        bbox={
            "facecolor": PAPER,
            "edgecolor": "none",
            "pad": 0.6 * pen.scale,
            "alpha": 1 if pen.lit else 0.85,
        },
        zorder=2,
    )


class PathPictures:
    """Pictures of a tree for films, each with the path to one leaf highlighted as `plot` does.

    The pale tree is drawn once and paths are drawn over it, which takes time in proportion to the path.

    Args:
        tree: The tree.
        most_pixels: The largest width and height.
        dpi: The resolution, reduced where the picture would be larger.
    """

    def __init__(self, tree: BaseTree, *, most_pixels: tuple[int, int], dpi: float) -> None:
        self._tree, self._parents, self._style = tree, _parents(tree), style_for(tree)
        with drawn_in(self._style):
            self._layout, self._boxes = arrange(tree, 4)
            self._scale = min(1.0, *(np.array(most_pixels) / (dpi * self._layout.extent)))
            self._dpi = max(_LEAST_DPI, dpi * self._scale)
            self._canvas = self._blank()
            draw(tree, self._layout, self._boxes, self._canvas.figure.axes[0], np.zeros(tree.n_nodes, bool))
            self._canvas.draw()
        self._pale = self._canvas.copy_from_bbox(self._canvas.figure.bbox)
        width, height = self._canvas.get_width_height()
        if self._dpi > dpi * self._scale:
            width, height = (max(1, round(length)) for length in dpi * self._scale * self._layout.extent)
        self.size = width, height
        """Width and height."""

    def whole(self) -> UInt8[np.ndarray, "height width 3"]:
        """Return the picture without a highlighted path."""
        with drawn_in(self._style):
            canvas = self._blank()
            draw(self._tree, self._layout, self._boxes, canvas.figure.axes[0])
            canvas.draw()
        return self._pixels(canvas)

    def path_to(self, leaf: int) -> UInt8[np.ndarray, "height width 3"]:
        """Return the picture with the path to a leaf highlighted."""
        lit: Bool[np.ndarray, " nodes"] = np.zeros(self._tree.n_nodes, bool)
        node = leaf
        while node >= 0:
            lit[node] = True
            node = int(self._parents[node])
        canvas, ax = self._canvas, self._canvas.figure.axes[0]
        with drawn_in(self._style):
            ax.clear()
            draw(self._tree, self._layout, self._boxes, ax, lit, only_lit=True)
            canvas.restore_region(self._pale)
            for artist in sorted((*ax.patches, *ax.texts), key=lambda artist: artist.get_zorder()):
                ax.draw_artist(artist)
        return self._pixels(canvas)

    def _blank(self) -> FigureCanvasAgg:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=tuple(self._layout.extent), dpi=self._dpi)
        figure.add_axes((0, 0, 1, 1))
        return FigureCanvasAgg(figure)

    def _pixels(self, canvas: FigureCanvasAgg) -> UInt8[np.ndarray, "height width 3"]:
        from PIL import Image

        picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
        if picture.size != self.size:
            picture = picture.resize(self.size, Image.Resampling.HAMMING)
        return np.asarray(picture)


def _parents(tree: BaseTree) -> np.ndarray:
    """Return the parent of each node, -1 for the root."""
    parents = np.full(tree.n_nodes, -1)
    for node in np.flatnonzero(~tree.is_leaf):
        parents[[tree.children_left[node], tree.children_right[node]]] = node
    return parents
