"""The front in words: on the terminal, and in Markdown."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from ...results.formatting import count, in_markdown, number, pipe_table
from ...runs.formatting import decimals
from .files import point_folder
from .front import Cost, Front, Point

if TYPE_CHECKING:
    from rich.table import Table

_COLUMNS = (
    "nodes", "rules", "depth", "validation ± 95 %", "test", "± std", "road", "steps", "episodes", "seconds",
)  # fmt: skip
"""Rules are leaves; ± 95 % is half of the interval of the mean over episodes; steps are environment steps, + a
teacher's; episodes are those that something was chosen by."""
_ON_TERMINAL = ("nodes", "rules", "validation ± 95 %", "test", "road", "steps", "seconds")
_MOST_PLACES = 3


class Step(NamedTuple):
    """A command that can follow a search."""

    command: str
    what: str


def table(front: Front) -> Table:
    """A line for each point, for a terminal of 80 columns: size, returns, how it was made, what it cost."""
    from rich.markup import escape
    from rich.table import Table

    made = Table(box=None, pad_edge=False, header_style="bold")
    for column in _ON_TERMINAL:
        made.add_column(column, justify="left" if column == "road" else "right", no_wrap=column != "road")
    for cells in _rows(front):
        made.add_row(*(escape(cells[column]) for column in _ON_TERMINAL))
    return made


def next_steps(front: Front, folder: str | os.PathLike[str], program: str = "sympol") -> list[Step]:
    """Return commands for the best point of a front in ``folder``."""
    run = shlex.quote(str(point_folder(folder, front.points[-1])))
    return [
        Step(f"{program} show {run}", "its rules"),
        Step(f"{program} report {run}", "a page: the tree at work"),
        Step(f"{program} eval {run} --episodes 100 --seed 7", "more test episodes"),
        Step(f"{program} export {run} --to c", "the policy as a program"),
    ]


def markdown(front: Front) -> str:
    """The same table in Markdown, what the whole run cost below it."""
    rows = [[in_markdown(cells[column]) for column in _COLUMNS] for cells in _rows(front)]
    return f"{pipe_table(_COLUMNS, rows)}\n\n{cost_line(front)}\n"


def format_cost(spent: Cost) -> str:
    """Return a cost in words: steps, a teacher's steps, selection episodes, seconds."""
    parts = [
        f"{short_count(spent.env_steps)} steps"
        + (f" + {short_count(spent.teacher_steps)} of a teacher" if spent.teacher_steps else "")
    ]
    parts += (
        [f"{short_count(spent.selection_episodes)} episodes to choose"] if spent.selection_episodes else []
    )
    return ", ".join([*parts, f"{spent.seconds:,.0f} s"])


def short_count(value: int) -> str:
    """Return a count with three digits: 1.23 M."""
    return count(float(f"{value:.3g}"))


def _rows(front: Front) -> list[dict[str, str]]:
    """A line for each point, by column."""
    places = _places(front.points)
    return [_cells(point, places) for point in front.points]


def _cells(point: Point, places: int) -> dict[str, str]:
    (low, high), tested = point.interval, point.test
    spent, teacher = point.cost, point.cost.teacher_steps
    return {
        "nodes": str(point.nodes),
        "rules": str(point.tree.n_leaves),
        "depth": str(point.tree.depth),
        "validation ± 95 %": f"{number(point.mean, places)} ± {number((high - low) / 2, places)}",
        "test": "—" if tested is None else number(tested.mean, places),
        "± std": "—" if tested is None else number(tested.std, places),
        "road": point.method,
        "steps": short_count(spent.env_steps) + (f" + {short_count(teacher)}" if teacher else ""),
        "episodes": short_count(spent.selection_episodes),
        "seconds": number(spent.seconds, 0),
    }


def cost_line(front: Front) -> str:
    """Return in one line what a whole run cost, and what it was made with."""
    tested = {point.test.episodes for point in front.points if point.test is not None}
    validated = {point.validation.episodes for point in front.points}
    facts = [
        format_cost(front.cost),
        f"validation on {_numbers(validated)} episodes",
        f"test on {_numbers(tested)}" if tested else "not tested",
        front.date[:10],
        f"commit {front.commit[:10]}" if front.commit else "",
    ]
    return "; ".join(filter(None, facts)) + "."


def _numbers(values: Iterable[int]) -> str:
    return " or ".join(f"{value:,}" for value in sorted(values))


def _places(points: Sequence[Point]) -> int:
    """Decimals that all returns of a table have, so many that points of one front do not look alike."""
    places = min(decimals(point.mean) for point in points)
    while places < _MOST_PLACES and any(b.mean - a.mean < 10.0**-places for a, b in pairwise(points)):
        places += 1
    return places
