"""A search in words: its progress while it runs, its front as a table for the terminal and in Markdown."""

from __future__ import annotations

import math
import os
import shlex
import threading
import time
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Self

from ...results.formatting import count, in_markdown, number, pipe_table
from ...runs.formatting import decimals
from ...runs.trust import needs_trust
from ..budget import Cost
from .config import SearchConfig, steps_of
from .files import point_folder
from .front import Front, Point
from .messages import PROGRESS, load_progress

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

PHASES = {
    "scratch": "training from scratch",
    "teacher": "training and distilling a teacher",
    "evolve": "evolving trees",
    "select": "selecting by validation",
    "test": "testing",
}
"""The phases of a search, as its progress names them."""
_SIZES_SHOWN = 4
"""Sizes whose best return is shown."""
_COLUMNS = (
    "nodes", "rules", "depth", "validation ± 95 %", "test", "± std", "method", "steps", "episodes", "seconds",
)  # fmt: skip
"""Rules are leaves; ± 95 % is half of the interval of the mean over episodes; steps are environment steps, + those of
a teacher; episodes are validation episodes by which something was chosen."""
_ON_TERMINAL = ("nodes", "rules", "validation ± 95 %", "test", "method", "steps", "seconds")
_MAX_DECIMALS = 3


class LiveProgress:
    """A progress line inside a ``with`` block; where the console is no terminal, one line for each phase.

    Args:
        config: The configuration of the search.
        folder: Its folder.
        console: The console to write to.
    """

    def __init__(self, config: SearchConfig, folder: Path, console: Console) -> None:
        self._config, self._folder, self._console = config, folder, console
        self._phase, self._began = "", time.perf_counter()
        self._status = console.status("")
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._renew, daemon=True)

    def __enter__(self) -> Self:
        """Show the line, and renew it each second."""
        if self._console.is_terminal:
            self._status.start()
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the line."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        self._status.stop()

    def watch(self, phase: str, seconds: float) -> None:
        """Show that a phase begins.

        Args:
            phase: One of `PHASES`.
            seconds: The seconds of the search so far.
        """
        self._phase = phase
        if not self._console.is_terminal:
            self._console.print(f"{seconds:,.0f} s: {PHASES[phase]}", markup=False)

    def _renew(self) -> None:
        while not self._over.wait(1):
            self._status.update(self.line())

    def line(self) -> str:
        """Return the line: the phase, the time, and the best return of a few sizes."""
        elapsed = time.perf_counter() - self._began
        line = f"{PHASES.get(self._phase, self._phase)} · {_clock(elapsed)}"
        if math.isfinite(self._config.seconds):
            line += f" of {_clock(self._config.seconds)}"
        best = self._best()
        sizes = sorted(best, reverse=True)
        shown = sorted(sizes[:: max(1, math.ceil(len(sizes) / _SIZES_SHOWN))])
        return " · ".join([line, *(f"{size} nodes: {best[size]:,.1f}" for size in shown)])

    def _best(self) -> dict[int, float]:
        """Return the best return of each size so far that beats those of smaller sizes."""
        best: dict[int, float] = {}
        for file in self._folder.glob(f"evolve/*/{PROGRESS}"):
            for size, mean in load_progress(file.parent).best.items():
                best[size] = max(mean, best.get(size, -math.inf))
        front: dict[int, float] = {}
        for size in sorted(best):
            if best[size] > max(front.values(), default=-math.inf):
                front[size] = best[size]
        return front


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


class Step(NamedTuple):
    """A command that can follow a search."""

    command: str
    description: str


def table(front: Front) -> Table:
    """Return a table for a terminal of 80 columns.

    Args:
        front: The front.

    Returns:
        A line for each point: its size, its returns, the methods that made it and its cost.
    """
    from rich.markup import escape
    from rich.table import Table

    grid = Table(box=None, pad_edge=False, header_style="bold")
    for column in _ON_TERMINAL:
        grid.add_column(column, justify="left" if column == "method" else "right", no_wrap=column != "method")
    for cells in _rows(front):
        grid.add_row(*(escape(cells[column]) for column in _ON_TERMINAL))
    return grid


def next_steps(front: Front, folder: str | os.PathLike[str], program: str = "sympol") -> list[Step]:
    """Return commands for the best point of a front.

    Args:
        front: The front.
        folder: Its folder.
        program: The name of the command.

    Returns:
        Commands with what each shows.
    """
    run = shlex.quote(str(point_folder(folder, front.points[-1])))
    played = f"{run} --trust" if needs_trust(front.environment) else run
    return [
        Step(f"{program} show {run}", "its rules"),
        Step(f"{program} report {played}", "a page: the tree at work"),
        Step(f"{program} eval {played} --episodes 100 --seed 7", "more test episodes"),
        Step(f"{program} export {run} --to c", "the policy as a program"),
    ]


def markdown(front: Front) -> str:
    """Return the table in Markdown, with the cost of the whole search below it.

    Args:
        front: The front.

    Returns:
        A pipe table and a line of text.
    """
    rows = [[in_markdown(cells[column]) for column in _COLUMNS] for cells in _rows(front)]
    return f"{pipe_table(_COLUMNS, rows)}\n\n{cost_line(front)}\n"


def format_cost(cost: Cost) -> str:
    """Return a cost in words.

    Args:
        cost: The cost.

    Returns:
        Its steps, those of a teacher, its validation episodes and its seconds.
    """
    parts = [
        f"{short_count(cost.env_steps)} steps"
        + (f" + {short_count(cost.teacher_steps)} of a teacher" if cost.teacher_steps else "")
    ]
    parts += [f"{short_count(cost.selection_episodes)} episodes to choose"] if cost.selection_episodes else []
    return ", ".join([*parts, f"{cost.seconds:,.0f} s"])


def format_excess(front: Front) -> str:
    """Return in words what a search spent beyond a budget in steps.

    Args:
        front: The front.

    Returns:
        A sentence; nothing where the budget was a time, or was enough.
    """
    budget = str(front.budget.get("budget", ""))
    excess = front.cost.steps - steps_of(budget)
    if not excess > 0:
        return ""
    return (
        f"{short_count(round(excess))} of the steps are beyond the budget of {budget}: distillation, pruning and "
        "selection are always finished"
    )


def short_count(value: int) -> str:
    """Return a count with three digits, such as ``1.23 M``."""
    return count(float(f"{value:.3g}"))


def _rows(front: Front) -> list[dict[str, str]]:
    """Return a line for each point, by column."""
    places = _places(front.points)
    return [_cells(point, places) for point in front.points]


def _cells(point: Point, places: int) -> dict[str, str]:
    (low, high), tested = point.interval, point.test
    cost, teacher = point.cost, point.cost.teacher_steps
    return {
        "nodes": str(point.nodes),
        "rules": str(point.tree.n_leaves),
        "depth": str(point.tree.depth),
        "validation ± 95 %": f"{number(point.mean, places)} ± {number((high - low) / 2, places)}",
        "test": "—" if tested is None else number(tested.mean, places),
        "± std": "—" if tested is None else number(tested.std, places),
        "method": point.method,
        "steps": short_count(cost.env_steps) + (f" + {short_count(teacher)}" if teacher else ""),
        "episodes": short_count(cost.selection_episodes),
        "seconds": number(cost.seconds, 0),
    }


def cost_line(front: Front) -> str:
    """Return the cost of a whole search, and the facts that its result depends on.

    Args:
        front: The front.

    Returns:
        One line of text.
    """
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
    """Return the decimals of all returns of a table, so many that points of one front do not look alike."""
    places = min(decimals(point.mean) for point in points)
    while places < _MAX_DECIMALS and any(b.mean - a.mean < 10.0**-places for a, b in pairwise(points)):
        places += 1
    return places
