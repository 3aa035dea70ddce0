"""Labels of marks in a panel, placed where they cover nothing."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float
    from matplotlib.axes import Axes

_SIZE = 6.5
_MARK = 4.0
"""The radius of a mark, in points."""
_LEADER = 8.0
"""The distance from its mark beyond which a label gets a leader line, in points."""
_ASTRAY = 200.0
"""The cost of a label that is nearer to another mark, in covered pixels."""
_OVER_LABEL = 10
"""The cost of covering another label, as a multiple of covering a mark."""


class Label(NamedTuple):
    """A text beside a mark of a panel."""

    x: float | None
    """None for a line across the panel."""
    y: float
    text: str
    colour: str


def place_labels(ax: Axes, labels: list[Label]) -> None:
    """Place every label near its mark, inside the panel, beside all marks and other labels.

    Where no position is free, the one that covers least is taken.

    Args:
        ax: The panel, in which everything else is drawn already.
        labels: The labels.
    """
    figure = ax.figure.canvas.figure
    figure.draw_without_rendering()  # texts have a size only after a layout
    pixels = figure.dpi / 72
    marks, written = _marks(ax, labels, pixels), np.empty((0, 4))
    owners = ax.transData.transform([(np.inf if label.x is None else label.x, label.y) for label in labels])
    for own, label in enumerate(labels):
        text = ax.text(0, 0, label.text, size=_SIZE, color=label.colour, ha="center", va="center", zorder=5)
        extent = text.get_window_extent()
        half = np.array([extent.width, extent.height]) / 2
        centres = _positions(ax, label, half, pixels)
        costs = [
            _outside(centre, half, ax)
            + _covered(centre, half, marks)
            + _OVER_LABEL * _covered(centre, half, written)
            + _ASTRAY * _is_astray(centre, half, owners, own)
            for centre in centres
        ]
        best = centres[int(np.argmin(costs))]
        # in units of the panel, so that it stays there at another resolution
        text.set_transform(ax.transAxes)
        text.set_position(tuple(ax.transAxes.inverted().transform(best)))
        near = np.clip(owners[own], best - half, best + half)
        if _LEADER * pixels < np.linalg.norm(near - owners[own]) < np.inf:
            _draw_leader(ax, owners[own], near, label.colour)
        written = np.concatenate([written, [[*(best - half), *(best + half)]]])


def _draw_leader(ax: Axes, start: np.ndarray, end: np.ndarray, colour: str) -> None:
    """Draw a thin line from a mark to its label."""
    x, y = ax.transAxes.inverted().transform([start, end]).T
    ax.plot(x, y, color=colour, linewidth=0.4, transform=ax.transAxes, gid="leader")


def _marks(ax: Axes, labels: list[Label], pixels: float) -> Float[np.ndarray, "marks 4"]:
    """Return lines and marks as small boxes, without those that are only background."""
    drawn = [np.empty((0, 4))]
    for line in ax.lines:
        if line.get_alpha() is not None:
            continue
        at = line.get_transform().transform(line.get_xydata())
        at = at[np.isfinite(at).all(axis=1)]
        has_marks = line.get_marker() not in (None, "None", "")
        reach = (_MARK if has_marks else 1) * pixels
        at = at if has_marks else _along(at, 2 * pixels)
        drawn.append(np.column_stack([at - reach, at + reach]))
    own = np.array([(label.x, label.y) for label in labels if label.x is not None], float).reshape(-1, 2)
    at = ax.transData.transform(own)
    return np.concatenate([*drawn, np.column_stack([at - _MARK * pixels, at + _MARK * pixels])])


def _along(corners: np.ndarray, step: float) -> np.ndarray:
    """Return points along a line through ``corners [n, 2]``, no further than ``step`` from each other."""
    pieces = [corners[:1]]
    for start, end in pairwise(corners):
        count = int(np.ceil(np.abs(end - start).max() / step)) + 1
        pieces.append(np.linspace(start, end, max(count, 2))[1:])
    return np.concatenate(pieces)


def _positions(ax: Axes, label: Label, half: np.ndarray, pixels: float) -> list[np.ndarray]:
    """Return the centres that a label may have, the nearest first."""
    if label.x is None:
        y = ax.transData.transform((1, label.y))[1]
        along = np.linspace(ax.bbox.x1 - half[0] - 2 * pixels, ax.bbox.x0 + half[0] + 2 * pixels, 12)
        above = [1, -1]
        return [np.array([x, y + side * (half[1] + 1.5 * pixels)]) for x in along for side in above]
    at = ax.transData.transform((label.x, label.y))
    directions = np.array(
        [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1), (-0.7, -1), (0.7, -1)]
    )
    gaps = np.array([5, 11, 18, 26, 36, 50, 70]) * pixels
    return [at + direction * (half + gap) for gap in gaps for direction in directions]


def _is_astray(centre: np.ndarray, half: np.ndarray, owners: Float[np.ndarray, "labels 2"], own: int) -> bool:
    """Return True where a label would be nearer to another one's mark than to its own."""
    away = np.linalg.norm(np.maximum(np.abs(owners - centre) - half, 0), axis=1)
    return bool(np.isfinite(away[own]) and away[own] > away.min())


def _outside(centre: np.ndarray, half: np.ndarray, ax: Axes) -> float:
    """Return a hundred times the area of a label outside the panel, in pixels squared."""
    panel = np.array([[*ax.bbox.min, *ax.bbox.max]])
    return 100 * (round(float(4 * half.prod()), 3) - _covered(centre, half, panel))


def _covered(centre: np.ndarray, half: np.ndarray, boxes: Float[np.ndarray, "boxes 4"]) -> float:
    """Return the area of boxes that a label covers, in pixels squared."""
    both = np.minimum(centre + half, boxes[:, 2:]) - np.maximum(centre - half, boxes[:, :2])
    # no overlap must be exactly 0 at every position, so that the nearest one wins
    return round(float(np.maximum(both, 0).prod(axis=-1).sum()), 3)
