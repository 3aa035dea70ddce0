"""The page of a tree alone: what there is to know without the run that made it."""

from __future__ import annotations

from typing import Any

from ..base import BaseTree
from ..floats import printable
from .page import write_page
from .policy import policy_data
from .programs import programs_data


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
    """Say how large a tree is, as the head of a page does."""
    return [[f"{tree.n_nodes:,}", "nodes"], [f"{tree.n_leaves:,}", "leaves"], [f"{tree.depth:,}", "depth"]]
