r"""A tree as a LaTeX picture, by the package forest (a part of TeX Live): ``\input{tree.tex}``.

Names come from strangers. Every character that TeX or forest takes for more than itself is written as a command
that prints it. What pdfLaTeX's own fonts lack, it would stop at: Greek letters become formulas, and everything else
is written by its number, such as U+1F600.
"""

from __future__ import annotations

import unicodedata

from ..base import BaseTree
from ..text import leaf_words, question, visit_share

_HEADER = r"""% a decision tree policy, written by sympol; it needs \usepackage{forest}, then \input{tree.tex}
\begin{forest}
for tree={draw, align=center, s sep=4mm, l sep=8mm},
yes/.style={edge label={node[midway, left, font=\scriptsize]{yes}}},
no/.style={edge label={node[midway, right, font=\scriptsize]{no}}},
action/.style={rounded corners}"""

_DEEPEST_INDENT = 100
"""Levels that are indented; without a limit, the lines of a chain take memory in proportion to its depth squared."""
_AS_ITSELF = " .,:;()/?!*+-=@"
_COMMANDS = {
    "\\": r"{\textbackslash}",
    "^": r"{\textasciicircum}",
    "~": r"{\textasciitilde}",
    "<": r"{\textless}",
    ">": r"{\textgreater}",
    "≤": r"{$\leq$}",
    "−": r"{$-$}",
    "°": r"{\textdegree}",
    "²": r"{$^2$}",
    "³": r"{$^3$}",
}
_LATIN = range(0xC0, 0x180)  # letters with accents, which LaTeX knows by itself


def to_latex(tree: BaseTree, *, digits: int | None = None) -> str:
    """Write a picture with yes to the left of no; leaves have round corners and their share of visits.

    Thresholds are written as by `sympol.trees.text`, in ``digits`` significant digits. forest takes its time over
    more than a few hundred nodes, and TeX's memory ends before a chain of thousands.

    Args:
        tree: The tree to write.
        digits: Significant digits of thresholds; as many as needed by default.

    Returns:
        The text of the picture.
    """
    lines = [_HEADER]
    awaited: list[tuple[int, str] | None] = [(0, "")]  # None: a bracket that closes
    depth = 0
    while awaited:
        if (entry := awaited.pop()) is None:
            depth -= 1
            lines.append("  " * min(depth, _DEEPEST_INDENT) + "]")
            continue
        node, edge = entry
        indent = "  " * min(depth, _DEEPEST_INDENT)
        if tree.is_leaf[node]:
            parts = [*leaf_words(tree, node, digits), visit_share(tree, node)]
            words = r"\\".join(_escaped(part) for part in parts if part)
            lines.append(f"{indent}[{{{words}}}{edge}, action]")
            continue
        asked = question(tree, node, digits)
        lines.append(f"{indent}[{{{_escaped(asked.words)}}}{edge}")
        depth += 1
        awaited += [None, (asked.no_child, ", no"), (asked.yes_child, ", yes")]
    return "\n".join([*lines, r"\end{forest}", ""])


def _escaped(words: str) -> str:
    return "".join(map(_printed, words))


def _printed(character: str) -> str:
    """Write one character as TeX prints it."""
    if character in _AS_ITSELF or (character.isascii() and character.isalnum()):
        return character
    if character in _COMMANDS:
        return _COMMANDS[character]
    if character.isascii():
        return (
            f"{{\\char{ord(character)}}}"  # also where a package gave it a meaning, as babel does to quotes
        )
    if ord(character) in _LATIN and character.isalpha():
        return character
    return _greek(character) or f"{{\\ttfamily U+{ord(character):04X}}}"


def _greek(character: str) -> str:
    """Write a Greek letter as the formula TeX has for it; nothing for other characters."""
    name = unicodedata.name(character, "").split()
    if name[:1] != ["GREEK"] or name[2:3] != ["LETTER"] or len(name) != 4:
        return ""
    command = _GREEK.get(name[3], name[3].lower())
    if name[1] == "CAPITAL" and command in _CAPITALS:
        return f"{{$\\{command.capitalize()}$}}"
    return f"{{$\\{command}$}}" if name[1] == "SMALL" and command in _SMALL else ""


_GREEK = {"LAMDA": "lambda"}
_CAPITALS = frozenset(
    ("gamma", "delta", "theta", "lambda", "xi", "pi", "sigma", "upsilon", "phi", "psi", "omega")
)
_SMALL = _CAPITALS | {
    "alpha",
    "beta",
    "epsilon",
    "zeta",
    "eta",
    "iota",
    "kappa",
    "mu",
    "nu",
    "rho",
    "tau",
    "chi",
}
