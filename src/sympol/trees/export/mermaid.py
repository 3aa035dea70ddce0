"""A tree as a Mermaid flowchart, which GitHub and many a wiki draw in the middle of a text.

Names come from strangers. They stand in quoted strings, and whatever in them is more than a letter, a digit or a
number is written as the entity of its number: Mermaid reads Markdown and HTML there, and line breaks, and formulas.
"""

from __future__ import annotations

import re

from ..base import BaseTree
from ..text import node_words, question, visit_share

_SPECIAL = re.compile(r"(?![.-][0-9])[^\w ,()≤]|_")
"""All but letters, digits and what means nothing to Mermaid within quotes; a number's point and sign may stay, too."""


def to_mermaid(tree: BaseTree, *, digits: int | None = None) -> str:
    """Write a flowchart with yes to the left of no; leaves have round corners and their share of visits.

    Thresholds are written as by `sympol.trees.text`, in ``digits`` significant digits.

    Args:
        tree: The tree to write.
        digits: Significant digits of thresholds; as many as needed by default.

    Returns:
        The text of the flowchart.
    """
    lines = ["flowchart TD"]
    for node in range(tree.n_nodes):
        if tree.is_leaf[node]:
            # on one line: after a <br>, Mermaid takes escaped characters for what they stand for
            share = visit_share(tree, node)
            words = node_words(tree, node, digits) + (f" ({share})" if share else "")
            lines.append(f'  n{node}("{_escaped(words)}")')
            continue
        asked = question(tree, node, digits)
        lines += [
            f'  n{node}["{_escaped(asked.words)}"]',
            f"  n{node} -->|yes| n{asked.yes_child}",
            f"  n{node} -->|no| n{asked.no_child}",
        ]
    return "\n".join([*lines, ""])


def _escaped(words: str) -> str:
    return _SPECIAL.sub(lambda match: f"#{ord(match[0])};", words) or " "  # an empty string is an error
