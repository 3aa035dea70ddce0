"""Boxes of a drawn tree: rows of words in a rounded frame, drawn with a pen.

The unit is an inch on paper, y grows downward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float
    from matplotlib.axes import Axes
    from matplotlib.patches import FancyBboxPatch

INK, LINE, PAPER = "#222222", "#8C8C8C", "#FFFFFF"
FONT_SIZE = 9.0  # points
ROW, PAD = 0.17, 0.09
_LONGEST_LABEL = 40  # characters
_FADED = 0.7
"""How much of the paper is mixed into what is not lit."""


@dataclass(frozen=True)
class Pen:
    """The axes to draw on, the scale, and whether this lies on the highlighted path (None if there is none)."""

    ax: Axes
    scale: float
    lit: bool | None = None

    def colour(self, colour: str) -> str:
        """Return the colour, made pale beside a highlighted path.

        Mixed instead of transparent: parts may lie over each other.
        """
        if self.lit is not False or colour == "none":
            return colour
        return "#" + "".join(f"{round(c * (1 - _FADED) + 255 * _FADED):02X}" for c in _rgb(colour))

    @property
    def outline(self) -> dict[str, Any]:
        """The outline of boxes, as arguments of a patch."""
        colour, width = (INK, 1.8) if self.lit else (LINE, 0.8)
        return {"edgecolor": self.colour(colour), "linewidth": width * self.scale}

    def words(
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: float = FONT_SIZE,
        on: str = PAPER,
        align: Literal["left", "center", "right"] = "center",
    ) -> None:
        """Write words at a position, in a colour that is readable on the background."""
        self.ax.text(
            x,
            y,
            words,
            size=size * self.scale,
            color=self.colour(readable_on(self.colour(on))),
            ha=align,
            va="center_baseline",
            parse_math=False,
            zorder=5,
        )

    def lines(self, points: Float[np.ndarray, "points 2"], fill: str, line: str, width: float) -> None:
        """Draw straight lines through points, closed if they are filled or end where they begin."""
        from matplotlib.patches import Polygon

        self.ax.add_patch(
            Polygon(
                points,
                closed=fill != "none" or bool((points[0] == points[-1]).all()),
                facecolor=self.colour(fill),
                edgecolor=self.colour(line),
                linewidth=width * self.scale,
                joinstyle="round",
                capstyle="round",
                zorder=4,
            )
        )


@dataclass(frozen=True)
class TextBox:
    """Rows of words, each with its own colour."""

    rows: tuple[str, ...]
    colours: tuple[str, ...]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, in inches."""
        return max(map(text_width, self.rows)) + 2 * PAD, len(self.rows) * ROW + PAD

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw the box around its centre."""
        from matplotlib.patches import Rectangle

        width, height = self.size
        x, y = centre - np.array([width, height]) / 2
        add = pen.ax.add_patch
        add(rounded(x, y, width, height, facecolor="none", **pen.outline, zorder=4))
        for row, (words, colour) in enumerate(zip(self.rows, self.colours, strict=True)):
            # each row paints down to the bottom, and the next one over it
            top = PAD / 2 + row * ROW if row else 0
            paint = {"facecolor": pen.colour(colour), "edgecolor": "none", "zorder": 3}
            add(rounded(x, y + top, width, height - top, **paint))
            if row:
                add(Rectangle((x, y + top), width, ROW / 2, **paint))
            pen.words(centre[0], y + PAD / 2 + (row + 0.5) * ROW, words, on=colour)


def rounded(x: float, y: float, width: float, height: float, **look: Any) -> FancyBboxPatch:
    """Return a box with round corners."""
    from matplotlib.patches import FancyBboxPatch

    return FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.06", **look)


def shortened(words: str) -> str:
    """Return the words, cut off where they do not fit into a box."""
    return words if len(words) <= _LONGEST_LABEL else words[: _LONGEST_LABEL - 1] + "…"


def text_width(words: str) -> float:
    """Return how wide the words will be, in inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=FONT_SIZE)
    width, _, _ = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    return width / 72


def readable_on(colour: str) -> str:
    """Return black or white, whichever stands out more."""
    red, green, blue = _rgb(colour)
    return INK if 0.299 * red + 0.587 * green + 0.114 * blue > 130 else PAPER


def _rgb(colour: str) -> Sequence[int]:
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
