"""The state of a call of `run_tasks`, whichever way tasks run: what is at work, done, failed, and the time left."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich import progress as bars
from rich.table import Column

from ..console import PrintableConsole
from ..interrupts import interrupts
from .task import Failure, Result, Task, TasksFailed

_NAMES = 3
"""The number of running tasks that are named; the others are counted."""


class Progress:
    """Passes results on, collects failures, and draws a line; where nobody watches, it prints a line for each task.

    Args:
        total: The number of tasks.
        on_done: Called with each task that is done and its result.
        parallel: How many tasks run at once, for the time left.
        show: Whether to print anything.
    """

    def __init__(
        self, total: int, on_done: Callable[[Task, Result], None], *, parallel: int = 1, show: bool = True
    ) -> None:
        self.total = total
        self.parallel = parallel
        self.done = 0
        self.failures: list[Failure] = []
        self._on_done = on_done
        self._started: dict[str, float] = {}
        self._ended: set[str] = set()
        self._seconds: list[float] = []
        self._show = show
        self._console = PrintableConsole(stderr=True, soft_wrap=True, highlight=False, emoji=False)
        self._lines = show and not self._console.is_terminal
        self._bar = bars.Progress(
            bars.TextColumn("[bold]tasks[/]"),
            bars.BarColumn(bar_width=20),
            bars.MofNCompleteColumn(),
            bars.TimeElapsedColumn(),
            bars.TextColumn("{task.fields[left]}"),
            bars.TextColumn("{task.fields[names]}", markup=False, table_column=Column(ratio=1, no_wrap=True)),
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
        """Stop drawing, and print what an interruption leaves and what failed."""
        self._bar.stop()
        if isinstance(error, KeyboardInterrupt):
            interrupts.take_last_word()
            self.print(
                f"stopped: {self.done} of {self.total} tasks are done and kept; "
                "run the same command again to resume"
            )
        for failure in self.failures:
            self.print(f"\n{failure.task.name}: {failure.reason}\n{failure.details.rstrip()}")

    def print(self, text: str) -> None:
        """Print a line above the bar."""
        if self._show:
            self._console.print(text, markup=False)

    def start(self, task: Task) -> None:
        """Record that a worker has begun a task."""
        if task.name in self._ended:  # a cluster can report the start after the result
            return
        self._started[task.name] = time.monotonic()
        self._draw()

    def finish(self, task: Task, answer: str) -> None:
        """Record the answer of `perform`, which is a result or an error."""
        content = json.loads(answer)
        if "error" in content:
            self.fail(task, content["error"], content["details"])
            return
        self._ended.add(task.name)
        seconds = time.monotonic() - self._started.pop(task.name, time.monotonic())
        self._seconds.append(seconds)
        self._on_done(task, content["result"])  # before it is counted: if this fails, it is not kept
        self.done += 1
        self._advance(f"{task.name} ({seconds:.1f} s)")

    def retry(self, task: Task, reason: str) -> None:
        """Record that a task's worker died and that the task will run again."""
        self._started.pop(task.name, None)
        self.print(f"{task.name}: {reason}; trying again")
        self._draw()

    def fail(self, task: Task, reason: str, details: str = "") -> None:
        """Record that a task is given up."""
        self._ended.add(task.name)
        self._started.pop(task.name, None)
        self.failures.append(Failure(task, reason, details))
        if not self._lines:
            self.print(f"{task.name}: {reason}")
        self._advance(f"{task.name}: {reason}")

    def raise_failures(self) -> None:
        """Raise TasksFailed if any task failed."""
        if self.failures:
            raise TasksFailed(self.failures, self.total)

    def seconds_left(self) -> float | None:
        """Estimate the seconds until all tasks are done, from the mean of those that are; None before the first."""
        if not self._seconds:
            return None
        mean = sum(self._seconds) / len(self._seconds)
        now = time.monotonic()
        running = [max(mean - (now - since), 0.0) for since in [*self._started.values()]]
        waiting = self.total - self.done - len(self.failures) - len(running)
        return max((sum(running) + waiting * mean) / max(self.parallel, 1), max(running, default=0.0))

    def _advance(self, line: str) -> None:
        if self._lines:
            self.print(f"[{self.done + len(self.failures)}/{self.total}] {line}{self._time_left()}")
        self._draw()

    def _time_left(self) -> str:
        left = self.seconds_left()
        if left is None or self.done + len(self.failures) == self.total:
            return ""
        minutes, seconds = divmod(round(left), 60)
        hours, minutes = divmod(minutes, 60)
        return f"  about {hours}:{minutes:02d}:{seconds:02d} left"

    def _draw(self) -> None:
        names = [*self._started]  # a copy: Dask reports starts in a thread of its own
        more = f" and {len(names) - _NAMES} more" if len(names) > _NAMES else ""
        self._bar.update(
            self._row,
            completed=self.done + len(self.failures),
            names=", ".join(names[:_NAMES]) + more,
            left=self._time_left(),
        )
