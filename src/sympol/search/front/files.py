"""A front as a folder.

| file | what |
|---|---|
| `front.json` | what was found, what it cost, what it was made with |
| `points/015-nodes/` | each point as a run's folder, of a tree that was not trained there (`sympol.runs.run`) |

Reading runs no code, and what is not as it was written is refused.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ... import files
from ...bounded import parse_json
from ...results.json_io import dumps, plain
from ...trees import DecisionTree
from .front import Cost, EvaluatedCandidate, Front, FrontError, Point, ReturnSummary

if TYPE_CHECKING:
    from ...envs.spec import EnvSpec

FORMAT = "sympol.front"
VERSION = 1
FILE = "front.json"
TreeOf: TypeAlias = Callable[[dict[str, Any]], DecisionTree]
"""From a point's fields to its tree; it takes out the fields that only it knows."""
_POINTS = "points"
_PLACE = re.compile(r"\d{3,}-nodes")


def point_folder(folder: str | PathLike[str], point: Point) -> Path:
    """Return the folder of a point in the folder of its front."""
    return _place(Path(folder), point.nodes)


def _place(folder: Path, nodes: int) -> Path:
    return folder / _POINTS / f"{nodes:03d}-nodes"


def save_front(front: Front, folder: str | PathLike[str], spec: EnvSpec) -> None:
    """Write the front; one that is there is replaced. ``front.json`` comes last: without it there is no front.

    Raises:
        RunError: something is in the way that is no point of ours, or cannot be written.
    """
    from ...runs.metadata import CONFIG, is_run

    folder = Path(folder)
    content = {
        "format": FORMAT,
        "version": VERSION,
        **fields_of(front),
        "points": [{**point_fields(point), "sha256": _digest(point.tree)} for point in front.points],
        "candidates": list(front.candidates),
    }
    (folder / FILE).unlink(missing_ok=True)
    places = {point_folder(folder, point) for point in front.points}
    for old in (folder / _POINTS).glob("*"):
        if _PLACE.fullmatch(old.name) and old not in places and is_run(old / CONFIG):
            shutil.rmtree(old)
    for point in front.points:
        _save_point(point_folder(folder, point), point, spec)
    files.write(folder / FILE, dumps(content))


def load_front(folder: str | PathLike[str]) -> Front:
    """Read a front.

    Raises:
        FrontError: there is none, or it is damaged, or a tree in it was changed.
    """
    folder = Path(folder)
    file = folder / FILE
    content = read_json(file, FORMAT, VERSION)

    def tree_of(fields: dict[str, Any]) -> DecisionTree:
        policy = _place(folder, fields["nodes"]) / "policy.json"
        text = policy.read_text(encoding="utf-8")
        if hashlib.sha256(text.encode()).hexdigest() != fields.pop("sha256"):
            raise FrontError(
                f"{policy} is not the tree that {FILE} says it is; what was measured is not said of this one"
            )
        return DecisionTree.from_json(text)

    try:
        return front_from(content, tree_of)
    except FrontError as error:
        raise FrontError(f"{file}: {error}") from error
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise FrontError(f"{file} cannot be read: {error!r}; run the search again") from error


def _save_point(path: Path, point: Point, spec: EnvSpec) -> None:
    from ...algorithms.config import Config
    from ...runs.run import Run

    distilled = {"method": point.method, "teacher": "a search for small trees", "seed": point.seed}
    with Run.create(path, spec, Config(), point.seed, overwrite=True, distilled=distilled) as run:
        run.save_tree(point.tree)
        run.save_summary(_summary_of(path, point, spec, distilled))


def _summary_of(path: Path, point: Point, spec: EnvSpec, distilled: Mapping[str, Any]) -> dict[str, Any]:
    from ...provenance import versions

    tested = (
        {}
        if point.test is None
        else {
            "return_mean": point.test.mean,
            "return_std": point.test.std,
            "episodes": point.test.episodes,
        }
    )
    return {
        "env": spec.name,
        **tested,
        "validation": asdict(point.validation),
        "nodes": point.nodes,
        "nodes_unpruned": point.nodes,
        "leaves": point.tree.n_leaves,
        "depth": point.tree.depth,
        "distilled": distilled,
        "spent": asdict(point.cost),
        "run_dir": str(path),
        "versions": versions(),
    }


def point_fields(point: Point) -> dict[str, Any]:
    """Return the JSON fields of a point, without its tree."""
    return {
        "nodes": point.nodes,
        "road": point.method,
        "seed": point.seed,
        "validation": asdict(point.validation),
        "test": None if point.test is None else asdict(point.test),
        "spent": asdict(point.cost),
    }


def fields_of(front: Front) -> dict[str, Any]:
    """Return the JSON fields of a front besides its points and candidates; raises ValueError for other objects."""
    return {
        "environment": front.environment,
        "seed": front.seed,
        "spent": asdict(front.cost),
        "budget": plain(front.budget),
        "versions": plain(front.versions),
        "commit": front.commit,
        "date": front.date,
    }


def front_from(content: Mapping[str, Any], tree_of: TreeOf) -> Front:
    """Make a front of its fields, those of `fields_of` and ``points`` and ``candidates``.

    Raises:
        FrontError, ValueError, TypeError, KeyError: they are not as they were written.
    """
    fields = dict(content)
    for name in ("environment", "commit", "date"):
        if not isinstance(fields[name], str):
            raise FrontError(f"{name} must be text, got {fields[name]!r}")
    for name in ("budget", "versions"):
        if not isinstance(fields[name], dict):
            raise FrontError(f"{name} must be an object, got {fields[name]!r}")
    fields["points"] = tuple(_point(dict(point), tree_of) for point in fields["points"])
    fields["candidates"] = tuple(EvaluatedCandidate(*row) for row in fields["candidates"])
    fields["cost"] = Cost(**fields.pop("spent"))
    return Front(**fields)


def _point(fields: dict[str, Any], tree_of: TreeOf) -> Point:
    tree, nodes = tree_of(fields), fields.pop("nodes")
    if isinstance(nodes, bool) or nodes != tree.n_nodes:
        raise FrontError(f"a tree has {tree.n_nodes} nodes, and not {nodes!r}, as is said of it")
    fields["validation"] = ReturnSummary(**fields["validation"])
    fields["test"] = None if fields["test"] is None else ReturnSummary(**fields["test"])
    fields["cost"] = Cost(**fields.pop("spent"))
    fields["method"] = fields.pop("road")
    return Point(tree=tree, **fields)


def read_json(file: Path, format_: str, version: int) -> dict[str, Any]:
    """Read strict JSON, an object of a format and version, which are left out; raises FrontError."""
    try:
        content = parse_json(files.read_text(file), "it")
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FrontError(f"there is no {file}; make one: sympol pareto ENV") from error
    except (OSError, ValueError) as error:
        raise FrontError(f"{file} cannot be read (was it cut off?): {error}") from error
    said = (content.pop("format", None), content.pop("version", None)) if isinstance(content, dict) else None
    if said != (format_, version):
        raise FrontError(f'{file} cannot be read: it lacks "format": "{format_}", "version": {version}')
    return content


def _digest(tree: DecisionTree) -> str:
    return hashlib.sha256(tree.to_json().encode()).hexdigest()
