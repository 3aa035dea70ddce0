"""A progress bar with time left, on the terminal's error stream."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType
from typing import Self

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from ..console import PrintableConsole
from .formatting import format_return


class ProgressBar:
    """Steps done and left, the deterministic tree's validation return, speed."""

    def __init__(self, total: int, done: int = 0, *, show: bool = True) -> None:
        self._progress = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=PrintableConsole(stderr=True),
            disable=not show,
        )
        self._total = total
        note = "compiling (the first time takes a few seconds)"
        self._task = self._progress.add_task("training", total=total, completed=done, note=note)

    def update(self, metrics: Mapping[str, float], whose: str = "") -> None:
        """Show the newest numbers.

        Args:
            metrics: The metrics.
            whose: Words before "return", if the policy is not the one that is wanted.
        """
        earned, fps = metrics["eval/mean_reward"], metrics["time/fps"]
        self._progress.update(
            self._task,
            completed=min(int(metrics["time/total_timesteps"]), self._total),
            note=f"{whose}return {format_return(earned)} · {fps:,.0f} steps/s",
        )

    def say(self, note: str) -> None:
        """Show what is being done instead of training."""
        self._progress.update(self._task, note=note)

    def __enter__(self) -> Self:
        """Start drawing."""
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop drawing; the bar stays."""
        self._progress.stop()
