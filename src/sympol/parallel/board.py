"""The state that all ways of running tasks share: workers, finished tasks, failures, and the rest."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Column

from ..console import PrintableConsole
from ..interrupts import interrupts
from .task import Failure, Result, Task, TasksFailed

_NAMES = 3
"""So many running tasks are named in the line; the others are counted."""


class Board:
    """Hands results on, collects failures, and draws one line (or, where nobody watches, writes one a task)."""

    def __init__(
        self, total: int, on_done: Callable[[Task, Result], None], *, parallel: int = 1, show: bool = True
    ) -> None:
        self.total = total
        self.parallel = parallel
        """How many tasks are done at once, for the time left."""
        self.done = 0
        self.failures: list[Failure] = []
        self._on_done = on_done
        self._since: dict[str, float] = {}
        self._over: set[str] = set()
        self._seconds: list[float] = []
        self._show = show
        self._console = PrintableConsole(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        self._lines = show and not self._console.is_terminal
        self._bar = Progress(
            TextColumn("[bold]tasks[/]"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            TextColumn("{task.fields[names]}", markup=False, table_column=Column(ratio=1, no_wrap=True)),
            expand=True,
            console=self._console,
            disable=not show or self._lines,
        )
        self._row = self._bar.add_task("tasks", total=total, names="", left="")

    def __enter__(self) -> Self:
        """Start drawing."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop drawing; tell what an interruption leaves, or what failed."""
        self._bar.stop()
        if isinstance(error, KeyboardInterrupt):
            interrupts.take_last_word()
            self.say(
                f"stopped: {self.done} of {self.total} tasks are done and kept; "
                "the same command again goes on from here"
            )
        for failure in self.failures:
            self.say(f"\n{failure.task.name}: {failure.reason}\n{failure.details.rstrip()}")

    def say(self, text: str) -> None:
        """A line beside the bar."""
        if self._show:
            self._console.print(text, markup=False)

    def start(self, task: Task) -> None:
        """It is being worked on."""
        if task.name in self._over:  # a cluster's word of its start can come after its result
            return
        self._since[task.name] = time.monotonic()
        self._draw()

    def answer(self, task: Task, answer: str) -> None:
        """Record the answer of `perform`."""
        content = json.loads(answer)
        if "error" in content:
            self.fail(task, content["error"], content["details"])
            return
        self._over.add(task.name)
        seconds = time.monotonic() - self._since.pop(task.name, time.monotonic())
        self._seconds.append(seconds)
        self._on_done(task, content["result"])  # before it is counted: if this fails, it is not kept
        self.done += 1
        self._ended(f"{task.name} ({seconds:.1f} s)")

    def retry(self, task: Task, reason: str) -> None:
        """Its worker is gone, another will do it."""
        self._since.pop(task.name, None)
        self.say(f"{task.name}: {reason}; trying again")
        self._draw()

    def fail(self, task: Task, reason: str, details: str = "") -> None:
        """It is given up; the others go on."""
        self._over.add(task.name)
        self._since.pop(task.name, None)
        self.failures.append(Failure(task, reason, details))
        if not self._lines:
            self.say(f"{task.name}: {reason}")
        self._ended(f"{task.name}: {reason}")

    def close(self) -> None:
        """Raise what there is to raise.

        Raises:
            TasksFailed: some tasks have failed.
        """
        if self.failures:
            raise TasksFailed(self.failures, self.total)

    def left(self) -> float | None:
        """Seconds until all is done, from the mean of what is done; None before the first."""
        if not self._seconds:
            return None
        mean = sum(self._seconds) / len(self._seconds)
        now = time.monotonic()
        begun = [max(mean - (now - since), 0.0) for since in [*self._since.values()]]
        unbegun = self.total - self.done - len(self.failures) - len(begun)
        return max((sum(begun) + unbegun * mean) / max(self.parallel, 1), max(begun, default=0.0))

    def _ended(self, line: str) -> None:
        if self._lines:
            self.say(f"[{self.done + len(self.failures)}/{self.total}] {line}{self._left()}")
        self._draw()

    def _left(self) -> str:
        left = self.left()
        if left is None or self.done + len(self.failures) == self.total:
            return ""
        minutes, seconds = divmod(round(left), 60)
        hours, minutes = divmod(minutes, 60)
        return f"  about {hours}:{minutes:02d}:{seconds:02d} left"

    def _draw(self) -> None:
        names = [*self._since]  # a copy: Dask tells what has started from a thread of its own
        more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
        self._bar.update(
            self._row,
            completed=self.done + len(self.failures),
            names=", ".join(names[:_NAMES]) + more,
            left=self._left(),
        )
