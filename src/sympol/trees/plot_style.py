"""The style of pictures: fonts for names in any script, and the files in which pictures are saved."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import files
from .actions import MultiDiscreteActions
from .base import BaseTree
from .floats import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_METADATA: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}, ".png": {}}
STYLE: dict[Any, Any] = {
    "svg.hashsalt": "sympol",  # the same tree, the same file
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "font.family": "DejaVu Sans",
    "text.usetex": False,
    "path.sketch": None,
}
_NO_FONTS = ("Last Resort", ".LastResort")
"""What these begin with has a box for every character there is."""
_MOST_NAMED = 8


def style_for(tree: BaseTree) -> dict[Any, Any]:
    """Return the style of all pictures, with fonts that have the characters of the tree's names.

    Warns where some are in no font of this machine: they become boxes.
    """
    fonts, lacking = _fonts_for(_characters(tree))
    if lacking:
        some = ", ".join(f"{c} ({c!a})" for c in lacking[:_MOST_NAMED])
        warnings.warn(
            "no font on this machine has these characters of the tree's names, so they become boxes in the picture: "
            f"{some}{', …' if len(lacking) > _MOST_NAMED else ''}; install one that has them, such as Noto",
            stacklevel=3,
        )
    return {**STYLE, "font.family": fonts}


@contextlib.contextmanager
def drawn_in(style: dict[Any, Any]) -> Iterator[None]:
    """Draw in a style of `style_for`, which has said already which characters no font has."""
    from matplotlib import rc_context

    with rc_context(style), warnings.catch_warnings():
        # matplotlib says it of each character, each time it looks at it
        warnings.filterwarnings("ignore", r"Glyph .* missing from font", UserWarning)
        yield


def _characters(tree: BaseTree) -> set[str]:
    actions = tree.actions
    names = [*tree.feature_names, *actions.names]
    if isinstance(actions, MultiDiscreteActions):
        names += [option for options in actions.options for option in options]
    names += [word for group in tree.groups for word in (group.name, *group.categories)]
    return set("".join(map(printable, names)))


def _fonts_for(characters: set[str]) -> tuple[list[str], list[str]]:
    """Return font families that cover the characters, the default first, and the characters no font has."""
    from matplotlib import font_manager

    own = str(STYLE["font.family"])
    lacking = {ord(c) for c in characters if not c.isascii()}
    lacking -= font_manager.get_font(font_manager.findfont(own)).get_charmap().keys()
    fonts = [own]
    upright = {
        entry.name: entry.fname
        for entry in font_manager.fontManager.ttflist
        if entry.style == "normal"
        and entry.weight in (400, "normal")
        and not entry.name.startswith(_NO_FONTS)
    }
    for family, file in sorted(upright.items()):
        if not lacking:
            break
        # a font that cannot be read, or of pictures instead of lines, is none
        with contextlib.suppress(OSError, RuntimeError, ValueError):
            font = font_manager.get_font(file)
            if font.scalable and lacking & font.get_charmap().keys():
                lacking -= font.get_charmap().keys()
                fonts.append(family)
    return fonts, sorted(map(chr, lacking))


def check_file(path: str | PathLike[str]) -> None:
    """Raise ValueError unless the path ends in .svg, .pdf or .png."""
    if Path(path).suffix.lower() not in _METADATA:
        raise ValueError(f"a plot is saved as .svg, .pdf or .png, got {str(path)!r}")


def save(figure: Figure, path: str | PathLike[str]) -> None:
    """Save a figure; equal figures give equal bytes."""
    dpi = min(200.0, 20_000 / max(figure.get_size_inches()))
    path, drawn = Path(path), io.BytesIO()
    suffix = path.suffix.lower()
    figure.savefig(drawn, format=suffix[1:], dpi=dpi, metadata=_METADATA[suffix])
    files.write(path, drawn.getvalue())
