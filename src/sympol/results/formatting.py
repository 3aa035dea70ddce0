"""Numbers as text, and tables as Markdown and LaTeX.

docs/design/libraries.md says why no library for tables is used.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .statistics import Interval, Moments

_IN_MARKDOWN = {
    "&": "&amp;", "<": "&lt;", ">": "&gt;", "|": "\\|", "*": "\\*", "_": "\\_", "`": "\\`", "](": "]\\(",
    "\\": "\\\\", "\n": " ",
}  # fmt: skip
_IN_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%", "_": r"\_",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\n": " ", "[": "{[}", "]": "{]}",
    "−": "$-$", "±": r"$\pm$", "→": r"$\to$", "∞": r"$\infty$", "×": r"$\times$", "≥": r"$\geq$", "≤": r"$\leq$",
    "▲": r"$\blacktriangle$", "▼": r"$\blacktriangledown$", "τ": r"$\tau$", "α": r"$\alpha$", "—": "---",
}  # fmt: skip


def number(value: float, places: int) -> str:
    """Return a number with a true minus sign, and none before zero.

    Args:
        value: The number, which may be infinite.
        places: The number of decimals.
    """
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:,.{places}f}"
    return text.replace("-", "−" if float(text.replace(",", "")) else "")


def spread(of: Moments, places: int) -> str:
    """Return "mean ± standard deviation" over trainings, or only the mean of a single training."""
    mean = number(of.mean, places)
    return mean if of.std is None else f"{mean} ± {number(of.std, places)}"


def interval(of: Interval, places: int = 2) -> str:
    """Return "estimate [low, high]"."""
    return f"{number(of.estimate, places)} [{number(of.low, places)}, {number(of.high, places)}]"


def as_printed(value: float) -> str:
    """Return a number with the decimals that its source prints."""
    return f"{value:,}".replace("-", "−")


def count(value: float) -> str:
    """Return a number of steps, abbreviated: 250 k, 1 M."""
    for unit, name in ((1e6, " M"), (1e3, " k")):
        if value >= unit:
            return f"{value / unit:g}{name}"
    return f"{value:g}"


class Entry(NamedTuple):
    """A cell of a grid: a value, with details below it."""

    text: str
    detail: str = ""
    bold: bool = False


class Grid(NamedTuple):
    """The rows and columns of a table, ready to be written in any format."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Entry, ...]], ...]


def markdown(grid: Grid) -> str:
    """Return a grid as a pipe table, with its title above and its note below."""

    def entry(of: Entry) -> str:
        text = f"**{in_markdown(of.text)}**" if of.bold else in_markdown(of.text)
        return f"{text}<br>{in_markdown(of.detail)}" if of.detail else text

    lines = [["", *map(in_markdown, grid.columns)], ["---", *["---:"] * len(grid.columns)]]
    lines += [[in_markdown(name), *map(entry, entries)] for name, entries in grid.rows]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return "\n\n".join(
        filter(None, [grid.title and f"### {in_markdown(grid.title)}", table, in_markdown(grid.note)])
    )


def pipe_table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table with right-aligned columns, from cells that are Markdown already."""
    lines = [columns, ["---:"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def latex(
    grids: Sequence[Grid], *, name: str, title: str, note: str, abbreviations: Mapping[str, str]
) -> str:
    """Return grids as floating tables in LaTeX; the document needs booktabs, graphicx and amssymb.

    Args:
        grids: The tables.
        name: Part of each label, ``tab:NAME``.
        title: Begins each caption.
        note: Ends the caption of the first table.
        abbreviations: Short forms of column names, which the caption explains.

    Returns:
        The tables, one after another.
    """
    return "\n".join(
        _float(grid, f"{name}{f'-{i + 1}' if i else ''}", title, "" if i else note, abbreviations)
        for i, grid in enumerate(grids)
    )


def in_markdown(text: str) -> str:
    """Return text with everything escaped that Markdown would interpret."""
    return _replaced(text, _IN_MARKDOWN)


def in_latex(text: str) -> str:
    """Return text with everything escaped that LaTeX would interpret."""
    return _replaced(text, _IN_LATEX)


def _float(grid: Grid, name: str, title: str, note: str, short: Mapping[str, str]) -> str:
    def entry(of: Entry) -> str:
        text = rf"\textbf{{{in_latex(of.text)}}}" if of.bold else in_latex(of.text)
        return rf"\shortstack[r]{{{text}\\{{\scriptsize {in_latex(of.detail)}}}}}" if of.detail else text

    title = ": ".join(filter(None, [title, grid.title]))
    columns = [short.get(column, column) for column in grid.columns]
    key = ", ".join(f"{short[column]}: {column}" for column in grid.columns if column in short)
    caption = " ".join(filter(None, [grid.note, note, f"{key}." if key else ""]))
    lines = [
        "% needs booktabs, graphicx, amssymb",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{\textbf{{{in_latex(title)}.}} {in_latex(caption)}}}",
        rf"\label{{tab:{name}}}",
        r"\resizebox{\linewidth}{!}{%",
        rf"\begin{{tabular}}{{l{'r' * len(columns)}}}",
        r"\toprule",
        " & ".join(["", *map(in_latex, columns)]) + r" \\",
        r"\midrule",
        *(" & ".join([in_latex(row), *map(entry, entries)]) + r" \\" for row, entries in grid.rows),
        r"\bottomrule",
        r"\end{tabular}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _replaced(text: str, by: dict[str, str]) -> str:
    """Replace each match once, so that no replacement is replaced again."""
    return re.sub("|".join(map(re.escape, by)), lambda found: by[found.group()], text)
