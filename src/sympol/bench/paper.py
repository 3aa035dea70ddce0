"""The paper's own numbers, found by the cells of ours (`paper.json` says what they are)."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, Literal, TypeAlias

from .record import Cell

Quantity: TypeAlias = Literal["return", "validation", "cohens_d", "nodes", "seconds"]
MEAN = "mean"
"""In place of an environment: what the paper says of all of them together."""


def paper_number(quantity: Quantity, cell: Cell) -> float | None:
    """What the paper has in a cell, or None. ``MEAN`` as its environment asks for the paper's mean."""
    numbers = _numbers()[quantity]
    return numbers.get("/".join((cell.algo, cell.method, *filter(None, [cell.variant]))), {}).get(
        cell.environment
    )


@cache
def _numbers() -> dict[str, Any]:
    return json.loads((files("sympol.bench") / "paper.json").read_text(encoding="utf-8"))
