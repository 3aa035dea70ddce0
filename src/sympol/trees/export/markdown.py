"""A tree as a Markdown table: a rule a row, with what it does and how often it did.

Names come from strangers. What Markdown, its tables, HTML or a linking reader would take for more than text is
escaped: by a backslash what every Markdown knows that way, as an entity everything else.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ..base import BaseTree
from ..text import checked_lines, leaf_conditions, leaf_words, visit_share

_BACKSLASHED = "\\`*_{}[]#!"
_AS_ENTITY = "&<>|~$@^=\"'"
_ESCAPES = {ord(c): f"\\{c}" for c in _BACKSLASHED} | {ord(c): f"&#{ord(c)};" for c in _AS_ENTITY}
_LINKS = re.compile(r"(?<=[A-Za-z]):(?=/)|(?<=[Ww]{3})\.")
"""What GitHub's Markdown makes links of without any mark: ``http://…`` and ``www.…``."""


def to_markdown(tree: BaseTree, *, digits: int | None = None) -> str:
    """Write a table with one row for each leaf, in the order of `DecisionTree.rules`.

    Visits are there where they are known. Thresholds are written as by `sympol.trees.text`, in ``digits``
    significant digits. A condition that has to hold beside another is joined to it by "and".

    Args:
        tree: The tree to write.
        digits: Significant digits of thresholds; as many as needed by default.

    Returns:
        The text of the table.

    Raises:
        ValueError: if it would have more characters than `sympol.trees.text` writes.
    """
    return "\n".join([*checked_lines(_rows(tree, digits)), ""])


def _rows(tree: BaseTree, digits: int | None) -> Iterator[str]:
    counted = tree.n_node_samples is not None
    yield _row(["When", "Action", *["Visits"] * counted])
    yield _row(["---", "---", *["---:"] * counted])
    for leaf, known in leaf_conditions(tree):
        conditions = " and ".join(condition.words(digits) for condition in known.values())
        cells = [
            conditions if known else "always",
            ", ".join(leaf_words(tree, leaf, digits)),
            *[visit_share(tree, leaf)] * counted,
        ]
        yield _row([_escaped(cell) for cell in cells])


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _escaped(words: str) -> str:
    return _LINKS.sub(lambda match: f"&#{ord(match[0])};", words.translate(_ESCAPES))
