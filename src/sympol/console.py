"""Consoles that write results to the standard output and everything else to the error stream."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from .trees.floats import printable


class PrintableConsole(Console):
    """A console that writes control characters as escapes such as ``\\x1b``, so that no file can drive the terminal.

    Everything that rich draws passes `render`, texts, tables, status lines and progress bars alike.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yield the segments of a renderable, free of control characters except rich's own."""
        for segment in super().render(renderable, options):
            text = segment.text
            if segment.control or all(c.isprintable() or c == "\n" for c in text):
                yield segment
            else:
                yield Segment("\n".join(map(printable, text.split("\n"))), segment.style)


out = PrintableConsole(soft_wrap=True, highlight=False, emoji=False)
"""The standard output."""
err = PrintableConsole(stderr=True, soft_wrap=True, highlight=False, emoji=False)
"""The error stream."""
