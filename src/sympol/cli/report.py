"""The commands that write pages: report, compare."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.markup import escape

from .. import files
from ..report import compare as compare_runs
from ..report import report as report_run
from ..runs.metadata import RunError
from ..runs.run import Run
from .arguments import Folder, PlaysRun
from .console import err, one_line_errors
from .parse import parse
from .tree_io import tree_from


@dataclass
class Report(PlaysRun):
    """One web page to see, question and copy a tree; it needs no network and nothing beside it."""

    run: Folder
    """The run's folder; or the .json or .txt of a tree, whose page has no episodes."""

    out: Path | None = None
    """The file; RUN/report.html by default, TREE.html beside the file of a tree."""

    episodes: int = 100
    """Test episodes on Gymnasium; the worst, the median and the best can be watched."""

    seed: int = 7
    """Another seed, other episodes; they are those of sympol eval."""

    properties: Path | None = None
    """A file of properties to prove (sympol verify); RUN/safety.toml by default, if it is there."""


@dataclass
class Compare(PlaysRun):
    """One web page of several policies on the same test episodes; trees, neural networks and soft trees."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The runs' folders, of one environment."""

    out: Path = Path("compare.html")
    """The file."""

    episodes: int = 100
    """Test episodes on Gymnasium; the first two can be watched."""

    seed: int = 7
    """Another seed, other episodes; they are those of sympol eval."""


@one_line_errors()
def report(arguments: Sequence[str]) -> int:
    """``sympol report``."""
    given = parse(Report, "report", arguments)
    if given.run.is_file():
        return _report_file(given)
    run = Run.open(given.run, given.env, trust=given.trust)
    path = given.out or given.run / "report.html"
    _require_folder(path)
    with err.status("") as status:
        page = report_run(
            run,
            episodes=given.episodes,
            seed=given.seed,
            properties=given.properties,
            progress=lambda words: status.update(escape(words)),
        )
    _write(path, page)
    return 0


def _report_file(given: Report) -> int:
    if given.properties is not None:
        raise RunError(f"--properties is for runs; prove them by sympol verify {given.run} --properties ...")
    path = given.out or given.run.with_suffix(".html")
    _require_folder(path)
    _write(path, tree_from(given.run).to_html())
    return 0


@one_line_errors()
def compare(arguments: Sequence[str]) -> int:
    """``sympol compare``."""
    given = parse(Compare, "compare", arguments)
    _require_folder(given.out)
    with err.status("") as status:
        page = compare_runs(
            [Run.open(path, given.env, trust=given.trust) for path in given.runs],
            episodes=given.episodes,
            seed=given.seed,
            progress=lambda words: status.update(escape(words)),
        )
    _write(given.out, page)
    return 0


def _require_folder(path: Path) -> None:
    """Refuse before anything is played what could not be written after it."""
    if not path.parent.is_dir():
        raise RunError(f"there is no folder {path.parent}; choose another --out")
    if path.is_dir():
        raise RunError(f"{path} is a folder; choose a file, such as --out {path / 'report.html'}")


def _write(path: Path, page: str) -> None:
    try:
        files.write(path, page)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
    err.print(f"written to {path} ({len(page) / 1e3:,.0f} kB); open it in a browser", markup=False)
