"""``sympol report``: one policy as a web page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.markup import escape

from .. import files
from ..runs.metadata import RunError
from ..runs.run import Run
from .arguments import Folder, PlaysRun, parse
from .console import err
from .tree_io import tree_from


@dataclass
class Report(PlaysRun):
    """Write a web page about a tree: its episodes, rules, programs. It needs no network and no other file."""

    run: Folder
    """The run's folder; or the .json or .txt of a tree, whose page has no episodes."""

    out: Path | None = None
    """The file; RUN/report.html by default, TREE.html beside the file of a tree."""

    episodes: int = 100
    """Number of test episodes on Gymnasium; the worst, the median and the best can be watched."""

    seed: int = 7
    """Seed of the episodes, which are those of sympol eval."""

    properties: Path | None = None
    """A file of properties to prove (sympol verify); RUN/safety.toml by default, if it is there."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol report``."""
    given = parse(Report, "report", words)
    if given.run.is_file():
        return _report_file(given)
    reported = Run.open(given.run, given.env, trust=given.trust)
    path = given.out or given.run / "report.html"
    require_folder(path)

    from ..report import report

    with err.status("") as status:
        page = report(
            reported,
            episodes=given.episodes,
            seed=given.seed,
            properties=given.properties,
            progress=lambda words: status.update(escape(words)),
        )
    write_page(path, page)
    return 0


def _report_file(given: Report) -> int:
    if given.properties is not None:
        raise RunError(f"--properties is for runs; prove them by sympol verify {given.run} --properties ...")
    path = given.out or given.run.with_suffix(".html")
    require_folder(path)
    write_page(path, tree_from(given.run).to_html())
    return 0


def require_folder(path: Path) -> None:
    """Refuse a file that cannot be written, before any episode is played.

    Raises:
        RunError: Its folder does not exist, or it is a folder.
    """
    if not path.parent.is_dir():
        raise RunError(f"there is no folder {path.parent}; choose another --out")
    if path.is_dir():
        raise RunError(f"{path} is a folder; choose a file, such as --out {path / 'report.html'}")


def write_page(path: Path, page: str) -> None:
    """Write a page, and print where.

    Raises:
        RunError: It cannot be written.
    """
    try:
        files.write(path, page)
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror or error}; choose another --out") from error
    err.print(f"written to {path} ({len(page) / 1e3:,.0f} kB); open it in a browser", markup=False)
