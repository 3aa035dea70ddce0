"""Properties of a policy as the page tells of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.floats import printable
from ..trees.report import packed

FILE = "safety.toml"


def properties_of(run: Run, given: Path | None) -> Path | None:
    """Return the file of properties: the one given, or the one in the run's folder, if there is one."""
    own = run.path / FILE
    return given or (own if own.is_file() else None)


def checks_data(tree: DecisionTree, file: Path) -> list[dict[str, Any]]:
    """Prove or refute the properties in a file.

    Raises:
        ValueError: the file says what is no property of this tree.
        OSError: it cannot be read.
    """
    return [
        {
            "name": printable(verdict.name),
            "rule": printable(verdict.rule),
            "holds": verdict.holds,
            "words": printable(verdict.words),
            "counterexample": None if verdict.counterexample is None else packed(verdict.counterexample),
        }
        for verdict in tree.verify(file)
    ]
