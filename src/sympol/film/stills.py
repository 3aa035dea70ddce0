"""Episodes as still pictures: contact sheets of frames, and routes through grid worlds drawn over maps."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from ..trees.plot_boxes import FONT_SIZE, INK, LINE, PAPER, Pen
from ..trees.plot_grid_view import LARGEST_CELL, glyph
from ..trees.plot_style import STYLE
from .frame_layout import font

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHEET_GAP, _SHEET_FONT_SIZE = 10, 13  # pixels
COLOURS, _DASHES = ("#CC2277", "#0060B0"), ((1.6, 0.8), ())
"""Style of the first and the second route; the first is also dashed, for readers who cannot tell the colours apart."""
_APART = 0.26
"""Distance, in cells, between two routes through the same cells."""
_TITLE, _LEGEND, _GAP = 0.26, 0.28, 0.12  # inches
_SMALLEST = 0.75
"""Texts and ends of routes are drawn at no less than this fraction of their size, however small the cells."""
_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
_DPI = 140


class Route(NamedTuple):
    """The cells of a route, (x, y) from the upper left corner, and whether the last one is the goal."""

    cells: Sequence[tuple[int, int]]
    arrives: bool


class Map(NamedTuple):
    """A grid world: MiniGrid's name of the object in each cell, row by row, and at most two routes from one start."""

    rows: Sequence[Sequence[str]]
    routes: Sequence[Route]
    title: str = ""


def contact_sheet(
    frames: Sequence[Image.Image], words: Sequence[str], *, columns: int = 6, width: int = 168
) -> Image.Image:
    """Draw frames in rows, each with a line of text below.

    Args:
        frames: Pictures of one size.
        words: A line for each frame.
        columns: Number of frames in a row.
        width: Width of a frame, in pixels.

    Returns:
        A picture of few colours, so that a PNG of it is small.

    Raises:
        ValueError: There are no frames, or not as many lines.
    """
    if not frames or len(frames) != len(words):
        raise ValueError(f"there must be words for each frame, got {len(words)} for {len(frames)} frames")
    height = round(width * frames[0].height / frames[0].width)
    row_height = height + _SHEET_FONT_SIZE + 2 * _SHEET_GAP
    columns = min(columns, len(frames))
    size = columns * (width + _SHEET_GAP) + _SHEET_GAP, -(-len(frames) // columns) * row_height + _SHEET_GAP
    picture = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(picture)
    for i, (frame, said) in enumerate(zip(frames, words, strict=True)):
        x, y = _SHEET_GAP + i % columns * (width + _SHEET_GAP), _SHEET_GAP + i // columns * row_height
        picture.paste(frame.resize((width, height), Image.Resampling.BOX), (x, y))
        draw.text((x, y + height + _SHEET_GAP), said, INK, font(_SHEET_FONT_SIZE), anchor="lm")
    return picture.quantize(64, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def draw_routes(
    maps: Sequence[Map], *, columns: int = 3, cell: float = LARGEST_CELL, names: Sequence[str] = ()
) -> Image.Image:
    """Draw maps in rows. A route starts at a triangle and ends in a dot at the goal, elsewhere in a cross.

    Args:
        maps: Maps of one size.
        columns: Number of maps in a row.
        cell: Size of a cell, in inches.
        names: Names of the first and the second routes, written below.

    Returns:
        A picture of few colours, so that a PNG of it is small.

    Raises:
        ValueError: There are no maps, or one has more than two routes.
    """
    if not maps or max(len(map_.routes) for map_ in maps) > len(COLOURS):
        raise ValueError("there must be maps, with at most two routes each")
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns, scale = min(columns, len(maps)), cell / LARGEST_CELL
    title = _TITLE * max(scale, _SMALLEST) if any(map_.title for map_ in maps) else 0.0
    legend = _LEGEND if names else 0.0
    size = cell * np.array([len(maps[0].rows[0]), len(maps[0].rows)])
    step = np.add(size, (_GAP, _GAP + title))
    total = np.add(step * (columns, -(-len(maps) // columns)), (_GAP, _GAP + legend))
    with rc_context(STYLE):
        figure = Figure(figsize=tuple(total), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        for i, map_ in enumerate(maps):
            left, top = np.add(step * (i % columns, i // columns), (_GAP, _GAP + title))
            place = left / total[0], 1 - (top + size[1]) / total[1], *(size / total)
            _draw_map(figure.add_axes(place), map_, scale)
        _write_names(figure.add_axes((0, 0, 1, max(legend, 0.01) / total[1])), total[0], names)
        file = io.BytesIO()
        canvas.print_png(file)
    picture = Image.open(file).convert("RGB")
    return picture.quantize(64, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _draw_map(ax: Axes, map_: Map, scale: float) -> None:
    ax.set_axis_off()
    ax.set(xlim=(0, len(map_.rows[0])), ylim=(len(map_.rows), 0))
    pen = Pen(ax, scale)
    for y, row in enumerate(map_.rows):
        for x, category in enumerate(row):
            pen.lines(np.add(_SQUARE, (x, y)), PAPER, LINE, 0.4)
            for line in glyph(category):
                pen.lines(np.add(line.points, (x, y)), line.fill, line.line, line.width)
    for i, route in enumerate(map_.routes):
        _draw_route(ax, route, i, (i - (len(map_.routes) - 1) / 2) * _APART, scale)
    if map_.title:
        size = FONT_SIZE * max(scale, _SMALLEST)
        ax.text(0, -0.12 / scale, map_.title, size=size, color=INK, va="bottom", parse_math=False)


def _draw_route(ax: Axes, route: Route, which: int, aside: float, scale: float) -> None:
    start, *points = np.array(route.cells) + 0.5
    points = np.array([start, *np.add(points or [start], aside)])
    for colour, width in ((PAPER, 4.2), (COLOURS[which], 2.2)):  # a rim of paper, on lava and walls
        (line,) = ax.plot(*points.T, color=colour, linewidth=width * scale, solid_joinstyle="round", zorder=6)
        if _DASHES[which] and colour != PAPER:
            line.set_dashes(_DASHES[which])
    large = max(scale, _SMALLEST)
    end = {"marker": "o" if route.arrives else "x", "markersize": 6 * large, "markeredgewidth": 2.4 * large}
    ax.plot(*points[-1], color=COLOURS[which], zorder=8, **end)
    ax.plot(*start, marker=">", markersize=8 * scale, color=INK, markeredgecolor=PAPER, zorder=7)


def _write_names(ax: Axes, width: float, names: Sequence[str]) -> None:
    ax.set_axis_off()
    ax.set(xlim=(0, width), ylim=(0, 1))
    x = _GAP
    for i, name in enumerate(names):
        (line,) = ax.plot([x, x + 0.4], [0.5, 0.5], color=COLOURS[i], linewidth=2.2)
        if _DASHES[i]:
            line.set_dashes(_DASHES[i])
        words = ax.text(x + 0.5, 0.5, name, size=FONT_SIZE, color=INK, va="center_baseline", parse_math=False)
        x = ax.transData.inverted().transform(words.get_window_extent().max)[0] + 0.3
