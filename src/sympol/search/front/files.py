"""A front as a folder.

| file | what |
|---|---|
| `front.json` | the points and candidates, their cost, the versions of everything |
| `points/015-nodes/` | each point as a run's folder, of a tree that was not trained there (`sympol.runs.run`) |

Reading runs no code, and a file that was changed is refused.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ... import files
from ...bounded import parse_json
from ...results.json_io import dumps, plain
from ...results.records import from_fields, renamed
from ...trees import DecisionTree
from ..budget import Cost
from .config import SearchConfig
from .front import EvaluatedCandidate, Front, FrontError, Point, ReturnSummary, current_method

if TYPE_CHECKING:
    from ...envs.spec import EnvSpec

FORMAT = "sympol.front"
VERSION = 1
FILE = "front.json"
TreeOf: TypeAlias = Callable[[dict[str, Any]], DecisionTree]
"""A function from the fields of a point to its tree; it removes the fields that only it knows."""
_POINTS = "points"
_POINT = re.compile(r"\d{3,}-nodes")


def point_folder(folder: str | PathLike[str], point: Point) -> Path:
    """Return the folder of a point.

    Args:
        folder: The folder of its front.
        point: The point.

    Returns:
        The run's folder of its tree.
    """
    return _point_folder(Path(folder), point.nodes)


def _point_folder(folder: Path, nodes: int) -> Path:
    return folder / _POINTS / f"{nodes:03d}-nodes"


def save_front(front: Front, folder: str | PathLike[str], spec: EnvSpec) -> None:
    """Write a front and its points; a front that is there is replaced.

    ``front.json`` is written last: without it there is no front.

    Args:
        front: The front.
        folder: Its folder; other files in it stay.
        spec: The environment of its trees.

    Raises:
        RunError: Something else is in the place of a point, or a file cannot be written.
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
    folders = {point_folder(folder, point) for point in front.points}
    for old in (folder / _POINTS).glob("*"):
        if _POINT.fullmatch(old.name) and old not in folders and is_run(old / CONFIG):
            shutil.rmtree(old)
    for point in front.points:
        _save_point(point_folder(folder, point), point, spec)
    files.write(folder / FILE, dumps(content))


def load_front(folder: str | PathLike[str]) -> Front:
    """Read a front.

    Args:
        folder: Its folder.

    Returns:
        The front, with the trees of its points.

    Raises:
        FrontError: There is none, it is damaged, or a tree in it was changed.
    """
    folder = Path(folder)
    file = folder / FILE
    content = read_json(file, FORMAT, VERSION)

    def tree_of(fields: dict[str, Any]) -> DecisionTree:
        policy = _point_folder(folder, fields["nodes"]) / "policy.json"
        text = policy.read_text(encoding="utf-8")
        if hashlib.sha256(text.encode()).hexdigest() != fields.pop("sha256"):
            raise FrontError(
                f"{policy} is not the tree that {FILE} describes: it was changed after it was measured"
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
        "cost": asdict(point.cost),
        "run_dir": str(path),
        "versions": versions(),
    }


def point_fields(point: Point) -> dict[str, Any]:
    """Return the JSON fields of a point, without its tree.

    Args:
        point: The point.

    Returns:
        Plain values by name.
    """
    return {
        "nodes": point.nodes,
        "method": point.method,
        "seed": point.seed,
        "validation": asdict(point.validation),
        "test": None if point.test is None else asdict(point.test),
        "cost": asdict(point.cost),
    }


def fields_of(front: Front) -> dict[str, Any]:
    """Return the JSON fields of a front without its points and candidates.

    Args:
        front: The front.

    Returns:
        Plain values by name.

    Raises:
        ValueError: Its budget or versions hold something that is no plain value.
    """
    return {
        "environment": front.environment,
        "seed": front.seed,
        "cost": asdict(front.cost),
        "budget": plain(front.budget),
        "versions": plain(front.versions),
        "commit": front.commit,
        "date": front.date,
    }


def front_from(content: Mapping[str, Any], tree_of: TreeOf) -> Front:
    """Make a front of its fields.

    Args:
        content: The fields that `fields_of` returns, ``points`` and ``candidates``; also by former names.
        tree_of: Returns the tree of a point.

    Returns:
        The front.

    Raises:
        FrontError, ValueError, TypeError, KeyError: They are not as they were written.
    """
    fields = renamed(Front, content)
    for name in ("environment", "commit", "date"):
        if not isinstance(fields[name], str):
            raise FrontError(f"{name} must be text, got {fields[name]!r}")
    for name in ("budget", "versions"):
        if not isinstance(fields[name], dict):
            raise FrontError(f"{name} must be an object, got {fields[name]!r}")
    fields["budget"] = renamed(SearchConfig, fields["budget"])
    fields["points"] = tuple(_point(renamed(Point, point), tree_of) for point in fields["points"])
    candidates = (EvaluatedCandidate(*row) for row in fields["candidates"])
    fields["candidates"] = tuple(one._replace(method=current_method(one.method)) for one in candidates)
    fields["cost"] = from_fields(Cost, fields["cost"])
    return Front(**fields)


def _point(fields: dict[str, Any], tree_of: TreeOf) -> Point:
    tree, nodes = tree_of(fields), fields.pop("nodes")
    if isinstance(nodes, bool) or nodes != tree.n_nodes:
        raise FrontError(f"a tree has {tree.n_nodes} nodes, but its point says {nodes!r}")
    fields["validation"] = from_fields(ReturnSummary, fields["validation"])
    fields["test"] = None if fields["test"] is None else from_fields(ReturnSummary, fields["test"])
    fields["cost"] = from_fields(Cost, fields["cost"])
    point = Point(tree=tree, **fields)
    return replace(point, method=current_method(point.method))


def read_json(file: Path, format_: str, version: int) -> dict[str, Any]:
    """Read a JSON file of a format and version.

    Args:
        file: The file.
        format_: The format that it must name.
        version: The version of the format.

    Returns:
        Its fields without these two.

    Raises:
        FrontError: There is no such file, it is no JSON, or of another format or version.
    """
    try:
        content = parse_json(files.read_text(file), "it")
    except (FileNotFoundError, NotADirectoryError) as error:
        raise FrontError(f"there is no {file}; make one: sympol pareto ENV") from error
    except (OSError, ValueError) as error:
        raise FrontError(f"{file} cannot be read (was it cut off?): {error}") from error
    found = (content.pop("format", None), content.pop("version", None)) if isinstance(content, dict) else None
    if found != (format_, version):
        raise FrontError(f'{file} cannot be read: it lacks "format": "{format_}", "version": {version}')
    return content


def _digest(tree: DecisionTree) -> str:
    return hashlib.sha256(tree.to_json().encode()).hexdigest()
