"""The tree in every text format there is, for the page's tabs."""

from __future__ import annotations

from ..base import BaseTree
from ..export import FORMATS

LARGEST = 60_000
"""Characters of one program; what is longer one rather exports than copies out of a page."""
LARGEST_SUM = 120_000
"""Of all of them: they must not be most of the page."""


def programs_data(tree: BaseTree) -> list[dict[str, str]]:
    """Write the tree in each format that is text; what is too long, or does not fit this tree, is left out."""
    programs: list[dict[str, str]] = []
    room = LARGEST_SUM
    for name, form in FORMATS.items():
        if form.binary:
            continue
        try:
            text = form.write(tree)
        except (
            ImportError,
            ValueError,
            TypeError,
        ):  # a library that is lacking, or a tree it has no form for
            continue
        if isinstance(text, str) and len(text) <= min(LARGEST, room):
            programs.append({"name": name, "title": form.title, "suffix": form.suffix, "text": text})
            room -= len(text)
    return programs
