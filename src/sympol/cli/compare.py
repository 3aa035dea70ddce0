"""``sympol compare``: several policies on one web page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.markup import escape

from ..runs.run import Run
from .arguments import PlaysRun, parse
from .console import err
from .report import require_folder, write_page


@dataclass
class Compare(PlaysRun):
    """Write a web page of several policies on the same test episodes: trees, neural networks, soft trees."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The folders of the runs, which must be of one environment."""

    out: Path = Path("compare.html")
    """The file to write."""

    episodes: int = 100
    """Number of test episodes on Gymnasium; the page shows the first two as films."""

    seed: int = 7
    """Seed of the episodes, which are those of sympol eval."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol compare``.

    Args:
        words: The words after the command's name.

    Returns:
        The exit status, 0.

    Raises:
        ValueError, RunError: An argument is wrong, or a folder holds no run that can be read.
    """
    given = parse(Compare, "compare", words)
    require_folder(given.out)

    from ..report import compare

    with err.status("") as status:
        page = compare(
            [Run.open(path, given.env, trust=given.trust) for path in given.runs],
            episodes=given.episodes,
            seed=given.seed,
            progress=lambda words: status.update(escape(words)),
        )
    write_page(given.out, page)
    return 0
