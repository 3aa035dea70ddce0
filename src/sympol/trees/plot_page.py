"""Where a drawn tree's boxes go on its page, and the file that it is saved in."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

from .. import files
from .base import BaseTree
from .layout import levels, tidy
from .plot_boxes import Pen

if TYPE_CHECKING:
    from jaxtyping import Bool, Float
    from matplotlib.figure import Figure

# inches, on paper
_PAGE = (10.0, 7.0)
_MARGIN = 0.15

_METADATA: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
STYLE: dict[Any, Any] = {
    "svg.hashsalt": "sympol",  # the same tree, the same file
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "text.usetex": False,
    "path.sketch": None,
}


class Drawable(Protocol):
    """A node's box."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, in inches."""
        ...

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw it around a place."""
        ...


Boxes = TypeVar("Boxes", bound=Sequence[Drawable])


@dataclass(frozen=True)
class Layout:
    """Centres and sizes of all boxes [nodes, 2], in inches from the upper left corner."""

    centre: Float[np.ndarray, "nodes 2"]
    size: Float[np.ndarray, "nodes 2"]
    downward: bool

    @property
    def extent(self) -> Float[np.ndarray, " 2"]:
        """Width and height of the picture."""
        return (self.centre + self.size / 2).max(axis=0) + _MARGIN


def lay_out(
    tree: BaseTree,
    boxes_when: Callable[[bool], Boxes],
    yes_is_right: Bool[np.ndarray, " nodes"] | None = None,
) -> tuple[Layout, Boxes]:
    """Lay boxes out downward if that can be read on a page, and else to the right if that is better.

    ``boxes_when`` makes a box for every node, told whether the tree grows downward.
    """
    downward, down_boxes = _one_way(tree, boxes_when, yes_is_right, downward=True)
    rightward, right_boxes = _one_way(tree, boxes_when, yes_is_right, downward=False)

    def scale_on_page(layout: Layout) -> float:
        return min(1.0, float(np.min(np.sort(_PAGE) / np.sort(layout.extent))))

    if scale_on_page(downward) >= min(0.8, scale_on_page(rightward)):
        return downward, down_boxes
    return rightward, right_boxes


def _one_way(
    tree: BaseTree,
    boxes_when: Callable[[bool], Boxes],
    yes_is_right: Bool[np.ndarray, " nodes"] | None,
    *,
    downward: bool,
) -> tuple[Layout, Boxes]:
    boxes = boxes_when(downward)
    size = np.array([box.size for box in boxes])
    width, height = size.T
    if downward:
        x, y = tidy(tree, width, 0.12, yes_is_right), levels(tree, height, gap=0.45)
    else:
        x, y = levels(tree, width, gap=0.55), tidy(tree, height, 0.07, yes_is_right)
    return Layout(np.stack([x, y], axis=1) + _MARGIN, size, downward), boxes


def check_file(path: str | PathLike[str]) -> None:
    """Raise ValueError for a file of a kind that no picture is saved as."""
    if Path(path).suffix.lower() not in _METADATA:
        raise ValueError(f"a plot is saved as .svg, .pdf or .png, got {str(path)!r}")


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Save a figure, the same one always as the same bytes."""
    dpi = min(200.0, 20_000 / max(figure.get_size_inches()))
    path, drawn = Path(path), io.BytesIO()
    suffix = path.suffix.lower()
    figure.savefig(drawn, format=suffix[1:], dpi=dpi, metadata=_METADATA[suffix])
    files.write(path, drawn.getvalue())
