"""Grids in Markdown and LaTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..bench.grids import Entry, Grid
from ..bench.methods import SHORT
from ..bench.tables import Table

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


def markdown(grid: Grid) -> str:
    """Return a pipe table under its title, its note below."""

    def entry(of: Entry) -> str:
        text = f"**{in_markdown(of.text)}**" if of.bold else in_markdown(of.text)
        return f"{text}<br>{in_markdown(of.detail)}" if of.detail else text

    lines = [["", *map(in_markdown, grid.columns)], ["---", *["---:"] * len(grid.columns)]]
    lines += [[in_markdown(name), *map(entry, entries)] for name, entries in grid.rows]
    table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    return "\n\n".join(
        filter(None, [grid.title and f"### {in_markdown(grid.title)}", table, in_markdown(grid.note)])
    )


def latex(table: Table, grids: Sequence[Grid], units: str) -> str:
    """Return a floating table for each grid; needs booktabs, graphicx and amssymb.

    Environments that have an abbreviation in the paper are abbreviated.
    """
    return "\n".join(_float(table, grid, units, i) for i, grid in enumerate(grids))


def in_markdown(text: str) -> str:
    """Text that is to be read as it is."""
    return _replaced(text, _IN_MARKDOWN)


def in_latex(text: str) -> str:
    """Text that is to be read as it is."""
    return _replaced(text, _IN_LATEX)


def _float(table: Table, grid: Grid, units: str, index: int) -> str:
    def entry(of: Entry) -> str:
        text = rf"\textbf{{{in_latex(of.text)}}}" if of.bold else in_latex(of.text)
        return rf"\shortstack[r]{{{text}\\{{\scriptsize {in_latex(of.detail)}}}}}" if of.detail else text

    title = ": ".join(filter(None, [table.title, grid.title]))
    shorts = [SHORT.get(column, column) for column in grid.columns]
    key = ", ".join(f"{SHORT[name]}: {name}" for name in grid.columns if name in SHORT)
    caption = " ".join(filter(None, [grid.note, units if index == 0 else "", f"{key}." if key else ""]))
    lines = [
        "% needs booktabs, graphicx, amssymb",
        r"\begin{table}",
        r"\centering",
        rf"\caption{{\textbf{{{in_latex(title)}.}} {in_latex(caption)}}}",
        rf"\label{{tab:{table.name}{f'-{index + 1}' if index else ''}}}",
        r"\resizebox{\linewidth}{!}{%",
        rf"\begin{{tabular}}{{l{'r' * len(shorts)}}}",
        r"\toprule",
        " & ".join(["", *map(in_latex, shorts)]) + r" \\",
        r"\midrule",
        *(" & ".join([in_latex(name), *map(entry, entries)]) + r" \\" for name, entries in grid.rows),
        r"\bottomrule",
        r"\end{tabular}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def _replaced(text: str, by: dict[str, str]) -> str:
    """Each character once, so that what was put in is not replaced again."""
    return re.sub("|".join(map(re.escape, by)), lambda found: by[found.group()], text)
