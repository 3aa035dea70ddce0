"""A tree as SQL: one query with one CASE expression for each number of an action, for PostgreSQL and for SQLite.

A column of the table is called as the feature is, where that can be a column's name; the column comes with the name
of the table before it, since SQLite takes a quoted name that is no column for a string, silently, when it stands alone.

Nothing is rounded to float32 in the query: `double_threshold` has done that, and PostgreSQL refuses to cast to real
what is too large for it. NaN goes right: PostgreSQL holds it for the greatest number, and what is unknown (NULL, which
is all that SQLite has) is no ``<=``.
"""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from itertools import chain, count
from typing import TYPE_CHECKING

import numpy as np

from ..base import BaseTree
from ..floats import double_threshold
from ..text import node_words
from .common import answers, branch_words, comment, legend, steps
from .formats import check_style
from .toolchain import Run, timed

if TYPE_CHECKING:
    from jaxtyping import Float32

_REAL = {"postgresql": "real", "sqlite": "REAL"}
_LONGEST = 63
"""Bytes of a name in PostgreSQL; it cuts off what is longer."""

_QUERY = """\
-- A decision tree policy, written by sympol: a query of {dialect} that adds the action to every row of a table.
--
{legend}
SELECT
  o.*,
{columns}
FROM {table} AS o;
"""


def to_sql(
    tree: BaseTree,
    *,
    style: str = "postgresql",
    table: str = "observations",
    columns: Sequence[str] | None = None,
) -> str:
    """Write a query whose column ``action`` is what `DecisionTree.predict` returns on each row of a table.

    With several components the columns are ``action_0``, ``action_1``, …; continuous actions are real, clipped, in C
    order, and a zero has no sign. Where a feature's column is called so, they are ``tree_action`` and so on, then
    ``tree_action_2``. It answers also where a group of features is not one-hot, which the tree refuses.

    Args:
        tree: What is written.
        style: ``"postgresql"`` or ``"sqlite"`` (3.23 or later).
        table: The table's name, as it is; it is quoted here.
        columns: Its column for each feature; by default `column_names`.

    Returns:
        The text of the query.

    Raises:
        ValueError: if there is no such style, an action has no number, or a name cannot be one.
    """
    check_style("sql", style)
    names = column_names(tree.feature_names) if columns is None else list(columns)
    if len(names) != tree.n_features:
        raise ValueError(f"expected the columns of {tree.n_features} features, got {names!r}")
    rows = answers(tree)
    labels = _labels(names, None if rows.single else rows.n_outputs)
    cases = []
    for k, label in enumerate(labels):
        written = [_real(x) if rows.is_float else str(x) for x in rows.rows[:, k].tolist()]
        case = "\n".join(_case(tree, names, [written[row] for row in rows.row_of]))
        cases.append(
            f"  CAST(\n{case}\n  AS {_REAL[style]}) AS {label}" if rows.is_float else f"{case}\n  AS {label}"
        )
    return _QUERY.format(
        dialect={"postgresql": "PostgreSQL", "sqlite": "SQLite"}[style],
        legend="\n".join(f"-- {line}" for line in legend(tree)),
        columns=",\n".join(cases),
        table=quoted(table),
    )


def _labels(columns: Sequence[str], n: int | None) -> list[str]:
    """Call the columns of the answers, of which there are n or just one, as no column of the table is called."""
    taken = {name.casefold() for name in columns}
    stems = chain(("action", "tree_action"), (f"tree_action_{i}" for i in count(2)))
    every = ([stem] if n is None else [f"{stem}_{k}" for k in range(n)] for stem in stems)
    return next(labels for labels in every if taken.isdisjoint(labels))


def column_names(features: Sequence[str]) -> list[str]:
    """Call each column as its feature, where that can be a column's name and is its own, else ``x0``, ``x1``, …

    To both databases a name has at most 63 bytes and no control characters; SQLite's do not differ by case alone.
    """
    folded = [name.casefold() for name in features]
    return [
        name
        if _is_name(name) and folded.count(folded[i]) == 1 and not (name[0] in "xX" and name[1:].isdigit())
        else f"x{i}"
        for i, name in enumerate(features)
    ]


def quoted(name: str) -> str:
    """Write a name as an identifier. Raises ValueError where it cannot be one."""
    if not _is_name(name):
        raise ValueError(
            f"a name in SQL must have 1 to {_LONGEST} bytes and no control characters, got {name!r}"
        )
    return '"' + name.replace('"', '""') + '"'


def _is_name(name: str) -> bool:
    return name.isprintable() and 0 < len(name.encode("utf-8", "replace")) <= _LONGEST


def _case(tree: BaseTree, names: Sequence[str], answer: Sequence[str]) -> Iterator[str]:
    """The lines of the expression: what follows an ``if`` is the next WHEN of the same CASE, or its ELSE."""
    is_open = [False] * (tree.depth + 1)
    for step in steps(tree):
        indent = "    " * step.level + "  "
        if step.kind == "if":
            if not is_open[step.level]:
                yield f"{indent}CASE"
            is_open[step.level] = True
            threshold = _real(double_threshold(tree.threshold[step.node]))
            asked = f"o.{quoted(names[int(tree.feature[step.node])])} <= {threshold}"
            asked = asked if step.side == "left" else f"({asked}) IS NOT TRUE"
            yield f"{indent}  WHEN {asked} THEN -- {comment(branch_words(tree, step))}"
        elif step.kind == "answer" and is_open[step.level]:
            is_open[step.level] = False
            yield f"{indent}  ELSE {answer[step.node]} -- {comment(node_words(tree, step.node))}"
            yield f"{indent}END"
        elif step.kind == "answer":
            yield f"{indent}{answer[step.node]} -- {comment(node_words(tree, step.node))}"


def _real(x: float) -> str:
    # of decimals with 17 digits SQLite reads one in 30,000 as the double beside it
    return f"{x:.20g}"


def run_sql(
    tree: BaseTree, x: Float32[np.ndarray, "batch features"], rounds: int, *, style: str = "postgresql"
) -> Run:
    """Run the query in SQLite on a table of observations: see `sympol.trees.export.check`."""
    if style == "postgresql":
        raise ValueError("there is no PostgreSQL here to run a query; add --style sqlite")
    n, columns = tree.n_features, [f"f{i}" for i in range(tree.n_features)]
    query = to_sql(tree, style=style, columns=columns)
    with contextlib.closing(sqlite3.connect(":memory:")) as database:
        database.execute(f"CREATE TABLE observations ({', '.join(f'{column} REAL' for column in columns)})")
        database.executemany(f"INSERT INTO observations VALUES ({', '.join('?' * n)})", x.tolist())
        table, seconds = timed(rounds, lambda: database.execute(query).fetchall())
    return Run(np.array([row[n:] for row in table], answers(tree).rows.dtype), seconds)
