"""Candidates of a task, saved as JSON: trees, the methods that made them, and their cost."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from ... import files
from ...bounded import parse_json
from ...trees import DecisionTree
from .front import Cost

FILE = "found.json"
PROGRESS = "heat.json"
"""The best return of each size so far, for the live display."""


@dataclass(frozen=True)
class Candidate:
    """A tree, the methods that made it, and its cost."""

    tree: DecisionTree
    method: str
    cost: Cost


def save_candidates(folder: Path, found: Iterable[Candidate], *, finished: bool) -> None:
    """Write the candidates that a task has found so far."""
    rows = [
        {"road": one.method, "spent": asdict(one.cost), "tree": json.loads(one.tree.to_json())}
        for one in found
    ]
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"finished": finished, "found": rows})
    files.write(folder / FILE, text)


def load_candidates(folder: Path) -> tuple[list[Candidate], bool]:
    """Read the candidates of a task and whether it is finished; none where there is no file.

    Raises:
        ValueError: the file is damaged.
    """
    file = folder / FILE
    if not file.exists():
        return [], False
    try:
        content = parse_json(files.read_text(file), "it")
        rows = [
            Candidate(DecisionTree.from_json(json.dumps(row["tree"])), str(row["road"]), Cost(**row["spent"]))
            for row in content["found"]
        ]
        return rows, bool(content["finished"])
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise ValueError(f"{file} cannot be read ({error!r}); remove {folder} and search again") from error
