"""A tree as a Graphviz graph: ``dot -Tsvg tree.dot``.

Names come from strangers. They stand in quoted strings, in which a quote, a backslash and an ampersand (Graphviz
reads HTML's entities there) are escaped, and nowhere else.
"""

from __future__ import annotations

from ..base import BaseTree
from ..text import leaf_words, question, visit_share

_HEADER = """\
// a decision tree policy, written by sympol; draw it: dot -Tsvg tree.dot -o tree.svg
digraph tree {
  graph [ordering=out];
  node [shape=box, fontname="Helvetica"];
  edge [fontname="Helvetica"];"""


def to_dot(tree: BaseTree, *, digits: int | None = None) -> str:
    """Write a graph with yes to the left of no; leaves have round corners and their share of visits.

    Thresholds are written as by `sympol.trees.text`, in ``digits`` significant digits.

    Args:
        tree: The tree to write.
        digits: Significant digits of thresholds; as many as needed by default.

    Returns:
        The text of the graph.
    """
    lines = [_HEADER]
    for node in range(tree.n_nodes):
        if tree.is_leaf[node]:
            parts = [*leaf_words(tree, node, digits), visit_share(tree, node)]
            # joined by a line break of Graphviz's own, which no name can write
            words = "\\n".join(_escaped(part) for part in parts if part)
            lines.append(f'  n{node} [label="{words}", style=rounded];')
            continue
        asked = question(tree, node, digits)
        lines += [
            f'  n{node} [label="{_escaped(asked.words)}"];',
            f'  n{node} -> n{asked.yes_child} [label="yes"];',
            f'  n{node} -> n{asked.no_child} [label="no"];',
        ]
    return "\n".join([*lines, "}", ""])


def _escaped(words: str) -> str:
    return words.replace("&", "&amp;").replace("\\", "\\\\").replace('"', '\\"')
