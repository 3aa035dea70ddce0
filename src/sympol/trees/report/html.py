"""The web page of a tree without the run that made it, and the programs it shows."""

from __future__ import annotations

from typing import Any

from ..base import BaseTree
from ..export import FORMATS
from ..floats import printable
from .page import write_page
from .policy import policy_data

LARGEST = 60_000
"""Most characters of one program; longer ones are exported instead of copied from a page."""
LARGEST_SUM = 120_000
"""Most characters of all programs together, so that they do not dominate the page."""


def to_html(tree: BaseTree) -> str:
    """Write the tree as a page: to look at, to ask, to fold, to copy; `sympol report` adds episodes and returns.

    Raises:
        ValueError: more nodes than a page can show.
    """
    title = printable(str(tree.meta.get("env") or "A policy"))
    rows = [[printable(str(name)), printable(str(value))] for name, value in tree.meta.items()]
    data = {
        "title": title,
        "kicker": "decision tree",
        "facts": size_facts(tree),
        "policy": policy_data(tree),
        "player": None,
        "tests": None,
        "curve": None,
        "checks": None,
        "programs": programs_data(tree),
        "provenance": {
            "rows": rows or [["tree", "given without a word on where it comes from"]],
            "config": None,
        },
    }
    return write_page(title, "report", data)


def size_facts(tree: BaseTree) -> list[list[Any]]:
    """Return the size of a tree as pairs of number and unit for the head of a page."""
    return [[f"{tree.n_nodes:,}", "nodes"], [f"{tree.n_leaves:,}", "leaves"], [f"{tree.depth:,}", "depth"]]


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
