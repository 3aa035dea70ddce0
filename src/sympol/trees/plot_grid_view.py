"""Small pictures of an agent's view for splits on what lies in one of its cells.

The agent stands in the middle of the lowest row and looks up. Only the cell asked about is filled in: a tree
looks at nothing else there. The words stand below, so that nothing is said by form or colour alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .floats import printable
from .groups import Group
from .plot_boxes import FONT_SIZE, INK, PAD, PAPER, ROW, Pen, rounded, shortened, text_width

if TYPE_CHECKING:
    from jaxtyping import Float

_NOT_ASKED, _GRID_LINE = "#F3F3F3", "#C4C4C4"
LARGEST_CELL, _SMALLEST_CELL, _GRID, _LARGEST_GRID = 0.25, 0.13, 0.75, 3.0  # inches


class _Line(NamedTuple):
    """A line through points of the unit square, y downward."""

    points: Float[np.ndarray, "points 2"]
    fill: str = "none"
    line: str = INK
    width: float = 0.8


def view_side(groups: tuple[Group, ...]) -> int:
    """Return the number of cells in each direction of the view; 0 if there is no view."""
    return max((1 + max(group.cell) for group in groups if group.cell is not None), default=0)


@dataclass(frozen=True)
class ViewBox:
    """A view of ``side`` cells in each direction, with the category asked about in one of them."""

    side: int
    cell: tuple[int, int]
    category: str
    words: str

    @property
    def _cell_size(self) -> float:
        return min(LARGEST_CELL, max(_SMALLEST_CELL, _GRID / self.side), _LARGEST_GRID / self.side)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, in inches."""
        grid = self.side * self._cell_size
        return max(grid, text_width(self._caption)) + 2 * PAD, grid + ROW + 1.5 * PAD

    @property
    def _caption(self) -> str:
        return shortened(self.words)

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw the box around its centre."""
        width, height = self.size
        x, y = centre - np.array([width, height]) / 2
        pen.ax.add_patch(rounded(x, y, width, height, facecolor=pen.colour(PAPER), **pen.outline, zorder=3))
        pen.words(centre[0], y + height - PAD / 2 - ROW / 2, self._caption)
        corner = np.array([centre[0] - self.side * self._cell_size / 2, y + PAD])
        agent = (self.side - 1, self.side // 2)

        self._draw_line(pen, corner, (0, 0), _Line(_SQUARE * self.side, _NOT_ASKED, _GRID_LINE, 0.6))
        for i in range(1, self.side):
            across = _Line(_ACROSS * self.side, line=_GRID_LINE, width=0.6)
            self._draw_line(pen, corner, (i, 0), across)
            self._draw_line(pen, corner, (0, i), across._replace(points=across.points[:, ::-1]))
        if agent != self.cell:
            self._draw_line(pen, corner, agent, _AGENT)

        lines = glyph(self.category)
        for line in (_Line(_SQUARE, PAPER, "none"), *lines, _Line(_SQUARE, width=2.2)):
            self._draw_line(pen, corner, self.cell, line)
        if not lines and self.category.casefold() != "empty":
            self._write_category(pen, corner)

    def _draw_line(
        self, pen: Pen, corner: Float[np.ndarray, " 2"], cell: tuple[int, int], line: _Line
    ) -> None:
        points = corner + (line.points + np.array(cell[::-1])) * self._cell_size
        # lines as strong in a small cell as in a large one would fill it
        width = line.width * self._cell_size / LARGEST_CELL
        pen.lines(points, line.fill, line.line, width)

    def _write_category(self, pen: Pen, corner: Float[np.ndarray, " 2"]) -> None:
        words = printable(self.category)
        words = words if len(words) <= 6 else words[:5] + "…"  # all of it is in the caption
        size = FONT_SIZE * min(0.8, 0.85 * self._cell_size / max(text_width(words), 0.01))
        x, y = corner + (np.array(self.cell[::-1]) + 0.5) * self._cell_size
        pen.words(x, y, words, size=size)


def glyph(category: str) -> tuple[_Line, ...]:
    """Return the drawing of a category, in the colour its name contains; empty if it is unknown.

    >>> len(glyph("red key")) == len(glyph("key"))
    True
    """
    *adjectives, noun = category.casefold().split() or [""]
    tint = None
    for adjective in adjectives:
        if adjective in _COLOURS:
            tint = _COLOURS[adjective]
        elif noun == "door" and adjective in _STATES:
            noun = adjective
        else:
            return ()
    lines = _GLYPHS.get(noun, ())
    return tuple(line._replace(fill=tint) if tint and line.fill == _TINT else line for line in lines)


def _box(left: float, top: float, right: float, bottom: float) -> Float[np.ndarray, "5 2"]:
    return np.array([(left, top), (right, top), (right, bottom), (left, bottom), (left, top)])


def _circle(x: float, y: float, radius: float) -> Float[np.ndarray, "33 2"]:
    angle = np.linspace(0, 2 * np.pi, 33)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1)


def _wave(y: float) -> _Line:
    x = np.linspace(0.14, 0.86, 25)
    return _Line(np.stack([x, y + 0.07 * np.sin((x - 0.14) / 0.36 * 2 * np.pi)], axis=1), width=1.1)


def _joint(*points: tuple[float, float]) -> _Line:
    return _Line(np.array(points), line=PAPER, width=0.8)


_TINT = "#B9B9B9"
"""What has a colour of its own, as long as it is not known."""

_SQUARE = _box(0, 0, 1, 1)
_ACROSS = np.array([(0, 0), (1, 0)])
_AGENT = _Line(np.array([(0.5, 0.16), (0.82, 0.84), (0.18, 0.84)]), "#4D4D4D", "#4D4D4D")
_DOOR = _Line(_box(0.24, 0.12, 0.76, 0.9), _TINT)
_KNOB = _Line(_circle(0.65, 0.53, 0.045), INK)

_GLYPHS: dict[str, tuple[_Line, ...]] = {
    "lava": (_Line(_SQUARE, "#F28E1C", "none"), _wave(0.26), _wave(0.5), _wave(0.74)),
    "wall": (
        _Line(_SQUARE, "#6E6E6E", "none"),
        _joint((0, 0.34), (1, 0.34)),
        _joint((0, 0.67), (1, 0.67)),
        *(_joint((x, top), (x, top + 0.33)) for x, top in ((0.5, 0.01), (0.25, 0.34), (0.75, 0.34), (0.5, 0.67))),
    ),
    "goal": (
        _Line(_SQUARE, "#8FD694", "none"),
        _Line(np.array([(0.34, 0.88), (0.34, 0.14)]), width=1.4),
        _Line(np.array([(0.34, 0.14), (0.8, 0.31), (0.34, 0.5)]), INK),
    ),
    "key": (
        _Line(_circle(0.5, 0.3, 0.17), _TINT),
        _Line(_circle(0.5, 0.3, 0.06), PAPER),
        _Line(np.array([(0.5, 0.47), (0.5, 0.88), (0.68, 0.88)]), width=1.4),
        _Line(np.array([(0.5, 0.7), (0.65, 0.7)]), width=1.4),
    ),
    "ball": (_Line(_circle(0.5, 0.5, 0.3), _TINT),),
    "box": (
        _Line(_box(0.18, 0.28, 0.82, 0.84), _TINT),
        _Line(np.array([(0.18, 0.47), (0.82, 0.47)])),
        _Line(_box(0.44, 0.4, 0.56, 0.56), PAPER),
    ),
    "door": (_DOOR, _KNOB),
    "closed": (_DOOR, _KNOB),
    "open": (
        _Line(_box(0.24, 0.12, 0.76, 0.9), PAPER),
        _Line(np.array([(0.24, 0.12), (0.48, 0.24), (0.48, 0.98), (0.24, 0.9)]), _TINT),
    ),
    "locked": (
        _DOOR,
        _Line(_circle(0.5, 0.44, 0.09), PAPER),
        _Line(_box(0.38, 0.47, 0.62, 0.68), INK),
    ),
    "floor": tuple(
        _Line(_box(x, y, x + 0.34, y + 0.34), _TINT, "none") for x in (0.12, 0.54) for y in (0.12, 0.54)
    ),
    "unseen": (
        _Line(_SQUARE, "#9A9A9A", "none"),
        *(_Line(np.array([(max(0, s - 1), min(1, s)), (min(1, s), max(0, s - 1))]), line=PAPER) for s in
          (0.35, 0.7, 1.0, 1.3, 1.65)),
    ),
    "agent": (_AGENT,),
}  # fmt: skip
_COLOURS = {
    "red": "#D7261E",
    "green": "#2CA02C",
    "blue": "#3B6FE0",
    "purple": "#8E44AD",
    "yellow": "#F5DC23",
    "grey": "#8A8A8A",
}
_STATES = ("open", "closed", "locked")
_GLYPHS |= {name: (_Line(_circle(0.5, 0.5, 0.34), colour),) for name, colour in _COLOURS.items()}
