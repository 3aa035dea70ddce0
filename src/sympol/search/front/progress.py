"""The live progress of a search: a line on the error stream, renewed each second."""

from __future__ import annotations

import math
import threading
import time
from pathlib import Path
from typing import Self

from rich.console import Console

from ... import files
from ...bounded import parse_json
from .candidates import PROGRESS
from .config import SearchConfig

WORDS = {
    "scratch": "training from scratch",
    "teacher": "a teacher, and trees of it",
    "evolve": "evolving trees",
    "choose": "choosing by validation",
    "test": "testing",
}
_SHOWN = 4
"""Sizes whose best return is shown."""


class LiveProgress:
    """A progress line inside a ``with`` block; where the console is no terminal, one line per method."""

    def __init__(self, plan: SearchConfig, folder: Path, console: Console) -> None:
        self._plan, self._folder, self._console = plan, folder, console
        self._doing, self._began = "", time.perf_counter()
        self._status = console.status("")
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._renew, daemon=True)

    def __enter__(self) -> Self:
        """Begin."""
        if self._console.is_terminal:
            self._status.start()
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave nothing on the terminal."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        self._status.stop()

    def watch(self, doing: str, seconds: float) -> None:
        """Receive what the search does now, and its seconds so far."""
        self._doing = doing
        if not self._console.is_terminal:
            self._console.print(f"{seconds:,.0f} s: {WORDS[doing]}", markup=False)

    def _renew(self) -> None:
        while not self._over.wait(1):
            self._status.update(self.words())

    def words(self) -> str:
        """Return the line."""
        elapsed = time.perf_counter() - self._began
        words = f"{WORDS.get(self._doing, self._doing)} · {_clock(elapsed)}"
        if math.isfinite(self._plan.seconds):
            words += f" of {_clock(self._plan.seconds)}"
        best = self._best()
        sizes = sorted(best, reverse=True)
        some = sorted(sizes[:: max(1, math.ceil(len(sizes) / _SHOWN))])
        return " · ".join([words, *(f"{size} nodes: {best[size]:,.1f}" for size in some)])

    def _best(self) -> dict[int, float]:
        """The best return of each size so far, as evolution says it after each heat."""
        best: dict[int, float] = {}
        for file in self._folder.glob(f"evolve/*/{PROGRESS}"):
            try:
                heat = parse_json(files.read_text(file), "it")
            except (OSError, ValueError):
                continue
            for size, value in heat.items():
                best[int(size)] = max(value, best.get(int(size), -math.inf))
        front: dict[int, float] = {}
        for size in sorted(best):
            if best[size] > max(front.values(), default=-math.inf):
                front[size] = best[size]
        return front


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
