"""The front in words: on the terminal, and in Markdown."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from ...results.number_format import count, given, number
from ...results.table_formats import in_markdown
from ...runs.formatting import decimals
from .files import point_folder
from .front import BestUnderSize, Cost, Front, Point, best_under_sizes, require_one_task, sizes_of
from .references import Target, targets

if TYPE_CHECKING:
    from rich.table import Table

_COLUMNS = (
    "nodes", "rules", "depth", "validation ± 95 %", "test", "± std", "road", "steps", "episodes", "seconds",
)  # fmt: skip
"""Rules are leaves; ± 95 % is half of the interval of the mean over episodes; steps are environment steps, + a
teacher's; episodes are those that something was chosen by."""
_ON_TERMINAL = ("nodes", "rules", "validation ± 95 %", "test", "road", "steps", "seconds")
_MOST_PLACES = 3
NONE_SO_SMALL = "none so small"


class Step(NamedTuple):
    """What can be typed next."""

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
    """What one may do with the best point of a front that is in ``folder``."""
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
    return f"{_pipes(_COLUMNS, rows)}\n\n{_whole(front)}\n"


def markdown_of_runs(fronts: Sequence[Front], asked: Iterable[Target] | None = None) -> str:
    """What several runs of one task reached with at most so many nodes: asked, mean and spread, each run.

    ``asked`` are by default the task's `targets`; where there are none, the sizes of all points.

    Raises:
        FrontError: as `best_under_sizes` does.
    """
    asked = list(asked or ()) or _asked(fronts)
    found = best_under_sizes(fronts, [target.nodes for target in asked])
    places = _places_of_runs(fronts)
    columns = ["at most", *(["asked"] if any(map(_wanted, asked)) else []), "test return"]
    columns += [f"seed {front.seed}" for front in fronts]
    rows = []
    for target, of in zip(asked, found, strict=True):
        row = [f"{target.nodes} nodes"]
        row += [_wanted(target) or "—"] if "asked" in columns else []
        rows.append([*row, _reached(target, of, places), *(_of_run(point, places) for _, point in of.runs)])
    whole = "\n".join(f"- seed {front.seed}: {_whole(front)}" for front in fronts)
    return f"{_pipes(columns, rows)}\n\n{whole}\n"


def markdown_of_tasks(tasks: Iterable[Sequence[Front]]) -> str:
    """The same for many tasks in one table, the test returns of all runs in its last column."""
    rows = []
    for fronts in tasks:
        asked = _asked(fronts)
        found = best_under_sizes(fronts, [target.nodes for target in asked])
        places = _places_of_runs(fronts)
        for i, (target, of) in enumerate(zip(asked, found, strict=True)):
            name = fronts[0].environment if i == 0 else ""
            runs = " ".join(_of_run(point, places).split(" ")[0] for _, point in of.runs)
            nodes = [point.nodes for _, point in of.runs if point is not None]
            size = f"{min(nodes)} to {max(nodes)}" if len({*nodes}) > 1 else "".join(map(str, nodes[:1]))
            reached = _reached(target, of, places)
            rows.append([name, str(target.nodes), _wanted(target) or "—", reached, size or "—", runs])
    return f"{_pipes(('task', 'at most', 'asked', 'test return', 'nodes', 'each run'), rows)}\n"


def markdown_by_roads(groups: Sequence[Sequence[Front]]) -> str:
    """What several runs reached with some roads, and with others: a line for each choice of roads.

    Raises:
        FrontError: as `best_under_sizes` does.
    """
    environment = require_one_task([runs[0] for runs in groups][:1])
    sizes = [target.nodes for target in targets(environment)] or sizes_of(groups[-1])
    places = min(decimals(point.mean) for runs in groups for front in runs for point in front.points)
    columns = ["roads", "runs", *(f"at most {size} nodes" for size in sizes), "steps", "seconds"]
    rows = []
    for runs in groups:
        reached = [_mean(of, places) for of in best_under_sizes(runs, sizes)]
        steps = sum(front.cost.steps for front in runs) / len(runs)
        seconds = sum(front.cost.seconds for front in runs) / len(runs)
        roads = in_markdown(" + ".join(map(str, runs[0].methods)) or "all")
        rows.append([roads, str(len(runs)), *reached, _short(round(steps)), number(seconds, 0)])
    return f"{_pipes(columns, rows)}\n\nTest returns; steps, with a teacher's, and seconds are means over runs.\n"


def format_cost(spent: Cost) -> str:
    """What something cost: its steps, its teacher's, episodes to choose by, seconds."""
    parts = [
        f"{_short(spent.env_steps)} steps"
        + (f" + {_short(spent.teacher_steps)} of a teacher" if spent.teacher_steps else "")
    ]
    parts += [f"{_short(spent.selection_episodes)} episodes to choose"] if spent.selection_episodes else []
    return ", ".join([*parts, f"{spent.seconds:,.0f} s"])


def _short(value: int) -> str:
    """Three digits are enough: 1.23 M."""
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
        "steps": _short(spent.env_steps) + (f" + {_short(teacher)}" if teacher else ""),
        "episodes": _short(spent.selection_episodes),
        "seconds": number(spent.seconds, 0),
    }


def _whole(front: Front) -> str:
    """What a whole run cost, and what it was made with."""
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


def _asked(fronts: Sequence[Front]) -> list[Target]:
    """The task's targets; where there are none, the sizes of all points."""
    asked = targets(require_one_task(fronts))
    return list(asked) or [Target(size, None) for size in sizes_of(fronts)]


def _places_of_runs(fronts: Sequence[Front]) -> int:
    return min(decimals(point.mean) for front in fronts for point in front.points)


def _wanted(target: Target) -> str:
    if target.mean is None:
        return target.words
    return given(target.mean)


def _reached(target: Target, of: BestUnderSize, places: int) -> str:
    """The mean over runs; bold where it is what was asked."""
    text = _mean(of, places)
    reached = target.mean is not None and of.mean is not None and of.mean >= target.mean
    return f"**{text}**" if reached else text


def _mean(of: BestUnderSize, places: int) -> str:
    if of.mean is None:
        return NONE_SO_SMALL
    return number(of.mean, places) + ("" if of.std is None else f" ± {number(of.std, places)}")


def _of_run(point: Point | None, places: int) -> str:
    if point is None or point.test is None:
        return NONE_SO_SMALL
    return f"{number(point.test.mean, places)} ({point.nodes})"


def _numbers(values: Iterable[int]) -> str:
    return " or ".join(f"{value:,}" for value in sorted(values))


def _places(points: Sequence[Point]) -> int:
    """Decimals that all returns of a table have, so many that points of one front do not look alike."""
    places = min(decimals(point.mean) for point in points)
    while places < _MOST_PLACES and any(b.mean - a.mean < 10.0**-places for a, b in pairwise(points)):
        places += 1
    return places


def _pipes(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [columns, ["---:"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
