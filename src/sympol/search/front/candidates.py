"""What a road has found, as a file: trees, how they were made, what that cost."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from ... import files
from ...bounded import parse_json
from ...trees import DecisionTree
from .front import Spent

FILE = "found.json"
HEAT = "heat.json"
"""The best return of each size so far, for whoever looks on."""


@dataclass(frozen=True)
class Found:
    """A tree, and the road to it."""

    tree: DecisionTree
    road: str
    spent: Spent


def keep(folder: Path, found: Iterable[Found], *, finished: bool) -> None:
    """Write what a road has found so far."""
    rows = [
        {"road": one.road, "spent": asdict(one.spent), "tree": json.loads(one.tree.to_json())}
        for one in found
    ]
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"finished": finished, "found": rows})
    files.write(folder / FILE, text)


def kept(folder: Path) -> tuple[list[Found], bool]:
    """What it has found, and whether it is at its end; nothing where there is no such file.

    Raises:
        ValueError: the file is damaged.
    """
    file = folder / FILE
    if not file.exists():
        return [], False
    try:
        content = parse_json(files.read_text(file), "it")
        rows = [
            Found(DecisionTree.from_json(json.dumps(row["tree"])), str(row["road"]), Spent(**row["spent"]))
            for row in content["found"]
        ]
        return rows, bool(content["finished"])
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise ValueError(f"{file} cannot be read ({error!r}); remove {folder} and search again") from error
