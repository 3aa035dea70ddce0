"""Fronts that are kept, ``studies/results/fronts/<task>.json``, and the page made of them, ``docs/fronts.md``.

Searches by only some methods are kept apart, in ``studies/results/fronts/methods``: beside the whole ones they show
what each method contributes.

``python -m studies.galleries.fronts [FOLDER ...]`` keeps what `save_front` wrote in those folders, and
writes the page
anew. A file holds several whole runs of one task, their trees with them; nothing on the page is typed by hand.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sympol import files
from sympol.results.json_io import dumps
from sympol.results.seeds import require_training_seed
from sympol.runs.metadata import file_name
from sympol.search.front.config import SHARES
from sympol.search.front.files import fields_of, front_from, load_front, point_fields, read_json
from sympol.search.front.formatting import markdown
from sympol.search.front.front import Front, FrontError, Point, require_one_task
from sympol.search.front.plot import plot
from sympol.trees import DecisionTree

from .plots import plot_gallery, smallest
from .published import published
from .tables import markdown_by_methods, markdown_of_runs, markdown_of_tasks

FORMAT = "sympol.fronts"
VERSION = 1
TASKS = (
    "CartPole-v1",
    "Acrobot-v1",
    "LunarLander-v3",
    "MountainCarContinuous-v0",
    "Pendulum-v1",
)
"""What comes first on the page; the others follow by name."""
_TREES = 3
"""Drawn of each task."""
_END = "\n\n"
_EMPTY = "Nothing has been run yet: `sympol pareto ENV`, then `python -m studies.galleries.fronts FOLDER`."


def keep(fronts: Iterable[Front], root: Path) -> list[Path]:
    """Write fronts into ``studies/results/fronts``; a run replaces one that is there with its seed, the others stay.

    Raises:
        FrontError: a front was not tested, or a file there is damaged.
        ValueError: a seed that is for searches, not for reports (`experiments.seeds`).
    """
    by_path: dict[Path, dict[int, Front]] = {}
    for front in fronts:
        if any(point.test is None for point in front.points):
            raise FrontError(f"the front of {front.environment} was not tested; what is kept must be")
        path = path_of(front.environment, root, front.methods)
        by_path.setdefault(path, {})[require_training_seed(front.seed)] = front
    written = []
    for path, new in by_path.items():
        there = {front.seed: front for front in load(path)} if path.exists() else {}
        runs = [front for _, front in sorted((there | new).items())]
        require_one_task(runs)  # two names may make one file's
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write(path, _to_json(runs))
        written.append(path)
    return written


def path_of(environment: str, root: Path, methods: Sequence[str] = ()) -> Path:
    """The file of a task below ``root``; of searches by only some methods, one of its own."""
    if len(methods) in (0, len(SHARES)):
        return _folder(root) / f"{file_name(environment)}.json"
    return _folder(root) / "methods" / f"{file_name(environment)}--{file_name('-'.join(methods))}.json"


def load(path: Path) -> list[Front]:
    """Read the runs of a file, by seed; raises FrontError where it is damaged."""
    content = read_json(path, FORMAT, VERSION)
    try:
        environment, runs, points = content["environment"], content["runs"], content["points"]
        fronts = [
            front_from(
                {
                    "environment": environment,
                    **run,
                    "points": [_without_run(point) for point in points if point["run"] == run["seed"]],
                    "candidates": [],
                },
                _tree_of,
            )
            for run in runs
        ]
        require_one_task(fronts)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise FrontError(f"{path} is not as it was written ({error}); keep its fronts again") from error
    return fronts


def load_all(root: Path) -> list[list[Front]]:
    """Read all files, the tasks in the order of the page."""
    found = [load(path) for path in sorted(_folder(root).glob("*.json"))]
    order = {name: i for i, name in enumerate(TASKS)}
    return sorted(found, key=lambda runs: (order.get(runs[0].environment, len(order)), runs[0].environment))


def load_parts(root: Path, environment: str) -> list[list[Front]]:
    """Read the searches of a task by only some methods, fewer methods first."""
    found = [
        load(path) for path in sorted((_folder(root) / "methods").glob(f"{file_name(environment)}--*.json"))
    ]
    return sorted(found, key=lambda runs: len(runs[0].methods))


def write_docs(
    tasks: Sequence[Sequence[Front]], docs: Path, parts: Sequence[Sequence[Sequence[Front]]] = ()
) -> list[Path]:
    """Write ``fronts.md`` and its pictures in ``images/fronts``; those of an older page go.

    ``parts`` are, task by task, searches by only some methods.
    """
    images = docs / "images" / "fronts"
    images.mkdir(parents=True, exist_ok=True)
    for old in images.glob("*.svg"):
        old.unlink()
    pictures = [images / "gallery.svg"] if tasks else []
    for picture in pictures:
        plot_gallery(tasks, picture)
    for fronts in tasks:
        pictures.append(_picture(images, fronts))
        plot(fronts, pictures[-1], beside=published(fronts[0].environment))
        for point, path in _drawn(images, fronts[0]):
            point.tree.plot(path)
            pictures.append(path)
    written = docs / "fronts.md"
    files.write(written, page(tasks, parts))
    return [written, *pictures]


def page(tasks: Sequence[Sequence[Front]], parts: Sequence[Sequence[Sequence[Front]]] = ()) -> str:
    """The page; its pictures lie in ``images/fronts``. ``parts`` are as of `write_docs`."""
    said = [
        "# Fronts",
        "Written by `python -m studies.galleries.fronts` from `studies/results/fronts`; nothing here is typed by hand.",
    ]
    if not tasks:
        return _END.join([*said, _EMPTY]) + "\n"
    said += [
        "A tree is chosen by what it earns in validation and tested once. A test return is the mean over test "
        "episodes of a deterministic tree, played on the original environments; mean ± standard deviation is over "
        "whole runs, in brackets the nodes of each run's tree. Bold: the mean reaches the target. *Published* is the "
        "best published tree of at most that size, its nodes in brackets. How to read the pictures: "
        "[the front](guides/pareto.md).",
        "![The fronts of all tasks, and their smallest trees](images/fronts/gallery.svg)",
        *(_section(fronts, list(some)) for fronts, some in itertools.zip_longest(tasks, parts, fillvalue=())),
    ]
    return _END.join(said) + "\n"


def readme(tasks: Sequence[Sequence[Front]]) -> str:
    """The gallery for the README: the picture, and a table of what was reached with at most so many nodes."""
    image = "![The front of every task, and its smallest trees](docs/images/fronts/gallery.svg)"
    return _END.join([image, markdown_of_tasks(tasks)])


def main(arguments: Sequence[str] | None = None) -> int:
    """See the module."""
    parser = argparse.ArgumentParser(prog="python -m studies.galleries.fronts", description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="fronts to keep, folders of sympol pareto")
    parser.add_argument("--root", type=Path, default=Path(), help="the repository")
    parser.add_argument("--readme", action="store_true", help="print the gallery of the README")
    given = parser.parse_args(arguments)
    try:
        kept = keep([load_front(folder) for folder in given.folders], given.root)
        tasks = load_all(given.root)
        parts = [load_parts(given.root, fronts[0].environment) for fronts in tasks]
        written = write_docs(tasks, given.root / "docs", parts)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(readme(tasks) if given.readme else "\n".join(map(str, [*kept, *written])))
    return 0


def _section(fronts: Sequence[Front], parts: Sequence[Sequence[Front]]) -> str:
    """A task: its picture, what all runs reached, what each method contributes, and the first run's trees."""
    first, name = fronts[0], fronts[0].environment
    images = Path("images") / "fronts"
    drawn = _drawn(images, first)
    said = [
        f"## {name}",
        f"![{name}: return against nodes]({_picture(images, fronts).as_posix()})",
        markdown_of_runs(fronts).rstrip(),
        *(
            [f"### {name}: what each method contributes", markdown_by_methods([*parts, fronts]).rstrip()]
            if parts
            else []
        ),
        f"### The trees of seed {first.seed}",
        markdown(first).split(_END)[0],
        *(f"![{name}: {point.nodes} nodes]({path.as_posix()})" for point, path in drawn),
        *(f"```text\n{point.tree.to_text()}\n```" for point, _ in drawn[-1:]),
    ]
    return _END.join(said)


def _drawn(images: Path, front: Front) -> list[tuple[Point, Path]]:
    """The trees that are drawn alone, and where."""
    slug = file_name(front.environment)
    return [(point, images / f"{slug}-{point.nodes:03d}.svg") for point in smallest(front, _TREES)]


def _picture(images: Path, fronts: Sequence[Front]) -> Path:
    return images / f"{file_name(fronts[0].environment)}.svg"


def _to_json(fronts: Sequence[Front]) -> str:
    """A line for each run and each point."""
    runs = [fields_of(front) for front in fronts]
    environment = {run.pop("environment") for run in runs}.pop()
    points = itertools.chain.from_iterable(
        (
            {"run": front.seed, **point_fields(point), "tree": json.loads(point.tree.to_json())}
            for point in front.points
        )
        for front in fronts
    )
    content: Mapping[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "environment": environment,
        "runs": runs,
        "points": list(points),
    }
    return dumps(content)


def _without_run(point: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in point.items() if name != "run"}


def _tree_of(fields: dict[str, Any]) -> DecisionTree:
    return DecisionTree.from_json(json.dumps(fields.pop("tree")))


def _folder(root: Path) -> Path:
    return root / "studies" / "results" / "fronts"


if __name__ == "__main__":
    sys.exit(main())
