"""The style of plots.

Every method has one colour, one kind of line and one mark in all of them, so that nothing is said by colour alone;
the colours are Okabe and Ito's. The same records give the same file.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .. import files
from ..trees.plot_style import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".svg", ".png", ".pdf")
_METADATA: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
PANEL = (2.6, 2.1)
"""Inches of one panel."""
_STYLE: dict[Any, Any] = STYLE | {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#E5E5E5",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 4,
}


class LineStyle(NamedTuple):
    """The colour, line and marker of a method."""

    colour: str
    line: Any
    marker: str


_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (4, 1, 1, 1)))
_STYLES = {
    "tree": LineStyle("#0072B2", _DASHES[0], "o"),
    "mlp": LineStyle("#E69F00", _DASHES[1], "s"),
    "sdt": LineStyle("#009E73", _DASHES[3], "^"),
    "d-sdt": LineStyle("#D55E00", _DASHES[2], "v"),
    "sa-dt-5": LineStyle("#CC79A7", _DASHES[1], "D"),
    "sa-dt-8": LineStyle("#CC79A7", _DASHES[3], "d"),
    "viper-5": LineStyle("#56B4E9", _DASHES[1], "P"),
    "viper-8": LineStyle("#56B4E9", _DASHES[2], "X"),
    "dagger-5": LineStyle("#56B4E9", _DASHES[3], "*"),
    "dagger-8": LineStyle("#56B4E9", _DASHES[0], "h"),
}
_OTHERS = ("#000000", "#999999", "#B8A800")


def style_of(method: str, others: Sequence[str] = ()) -> LineStyle:
    """Return the style of a method.

    Args:
        method: The method's name.
        others: Methods that have no style of their own; each gets one by its place.
    """
    method = method.removesuffix("-paper")
    if method in _STYLES:
        return _STYLES[method]
    place = others.index(method) if method in others else 0
    return LineStyle(_OTHERS[place % len(_OTHERS)], _DASHES[place // len(_OTHERS) % len(_DASHES)], "*")


@contextmanager
def styled() -> Iterator[None]:
    """Apply our style to everything drawn in this context."""
    from matplotlib import rc_context

    with rc_context(_STYLE):
        yield


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as .svg, .png or .pdf, by the path's suffix; the same figure gives the same bytes."""
    drawn = io.BytesIO()
    with styled():
        figure.savefig(drawn, format=path.suffix[1:], dpi=160, metadata=_METADATA[path.suffix])
    files.write(path, drawn.getvalue())
    return path


def panels(rows: int, columns: int, *, height: float = PANEL[1]) -> tuple[Figure, list[list[Axes]]]:
    """Return a figure of ``rows × columns`` panels of one size, and its axes by row; ``height`` is in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PANEL[0] * columns, height * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False).tolist()


def legend_below(figure: Figure, axes: Iterable[Axes], columns: int = 4) -> None:
    """Add one legend for all panels below them, each name once, in at most ``columns`` columns."""
    found = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if found:
        figure.legend(
            found.values(),
            found.keys(),
            loc="outside lower center",
            ncols=min(columns, len(found)),
            handlelength=3,
        )
