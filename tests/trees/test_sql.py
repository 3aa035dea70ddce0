"""Queries on real databases: SQLite, and PostgreSQL with its NaN, its casts and its names."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.export.sql import column_names, quoted, to_sql
from sympol.trees.floats import double_threshold

from ..tune.postgres import Server, server
from .programs.running import STRANGE, trees
from .samples import HOSTILE_NAMES

__all__ = ["server"]


@pytest.fixture
def database(server: Server) -> Iterator[Any]:
    psycopg = pytest.importorskip("psycopg")
    with psycopg.connect(server.url()) as connection:
        yield connection


def fill(database: Any, columns: list[str], x: np.ndarray, kind: str = "double precision") -> None:
    names = ", ".join(f"{quoted(name)} {kind}" for name in columns)
    database.execute(f"CREATE TEMPORARY TABLE observations (id integer, {names})")
    with database.cursor().copy("COPY observations FROM STDIN") as copy:
        for i, row in enumerate(x.tolist()):
            copy.write_row([i, *row])


def answered(database: Any, query: str, n: int) -> np.ndarray:
    """What each row is answered, in order; PostgreSQL says real numbers in the fewest digits that are their own."""
    rows = sorted(database.execute(query.rstrip().rstrip(";")).fetchall())
    return np.array([row[1 + n :] for row in rows], np.float32)


@pytest.mark.parametrize("kind", ["double precision", "real"])
@pytest.mark.parametrize(
    "name",
    [
        "trained",
        "multi_discrete",
        "box",
        "grouped discrete",
        "chain to the left",
        "chain to the right",
        "2047 nodes",
    ],
)
def test_postgresql_acts_as_the_tree_does(database, name, kind):
    from sympol.trees.export.check import check_observations

    tree = trees()[name]
    x = check_observations(tree, 12_000)
    columns = [f"c{i}" for i in range(tree.n_features)]
    fill(database, columns, x, kind)
    acted = answered(database, to_sql(tree, columns=columns), tree.n_features)
    assert (acted == tree.predict(x).reshape(len(x), -1)).all()


def edges(tree: DecisionTree, rng: np.random.Generator, n: int) -> np.ndarray:
    """Doubles on both sides of where rounding to float32 carries them over a threshold, and far away."""
    at = np.array([double_threshold(t) for t in tree.threshold[~tree.is_leaf]])
    far = [1e300, -1e300, 1e-300, -1e-300, 5e-324, np.inf, -np.inf, np.nan, 0.0]
    return rng.choice(np.concatenate([at, np.nextafter(at, np.inf), far]), (n, tree.n_features))


def test_doubles_are_rounded_as_the_tree_rounds_them(database):
    tree = trees()["2047 nodes"]
    x = edges(tree, np.random.default_rng(30), 5000)
    columns = [f"c{i}" for i in range(tree.n_features)]
    expected = tree.predict(x).reshape(len(x), -1)
    fill(database, columns, x)
    assert (answered(database, to_sql(tree, columns=columns), tree.n_features) == expected).all()
    with contextlib.closing(sqlite3.connect(":memory:")) as lite:
        lite.execute(f"CREATE TABLE observations (id INTEGER, {', '.join(f'{c} REAL' for c in columns)})")
        rows = [(i, *row) for i, row in enumerate(x.tolist())]
        lite.executemany(f"INSERT INTO observations VALUES ({', '.join('?' * (1 + len(columns)))})", rows)
        query = to_sql(tree, style="sqlite", columns=columns)
        assert (answered(lite, query, tree.n_features) == expected).all()


def test_sqlite_reads_thresholds_as_they_are():
    rng = np.random.default_rng(31)
    bits = rng.integers(0, 2**32, 20_000, dtype=np.uint32).view(np.float32)
    thresholds = [double_threshold(t) for t in bits[np.isfinite(bits) & (np.abs(bits) >= 2.0**-126)]]
    with contextlib.closing(sqlite3.connect(":memory:")) as lite:
        for i in range(0, len(thresholds), 1000):
            part = thresholds[i : i + 1000]
            (read,) = lite.execute("SELECT " + ", ".join(f"{t:.20g}" for t in part))
            assert list(read) == part


def strange_tree() -> DecisionTree:
    n = len(STRANGE)
    names = tuple(STRANGE)
    return DecisionTree.from_complete(
        np.resize(np.arange(n), 63), np.linspace(-1, 1, 63), np.eye(64, n), actions=DiscreteActions(n, names),
        feature_names=names,
    )  # fmt: skip


def test_both_databases_take_columns_of_any_name(database):
    tree = strange_tree()
    columns = column_names(tree.feature_names)
    assert {"'; DROP TABLE observations; --", "if", "*/ int x = ;", f"x{len(STRANGE) - 1}"} <= {*columns}
    x = np.random.default_rng(32).normal(size=(300, tree.n_features))
    fill(database, columns, x)
    expected = tree.predict(x)[:, None]
    assert (answered(database, to_sql(tree), tree.n_features) == expected).all()
    with contextlib.closing(sqlite3.connect(":memory:")) as lite:
        table = 'a "strange" table; --'
        names = ", ".join(f"{quoted(c)} REAL" for c in columns)
        lite.execute(f"CREATE TABLE {quoted(table)} (id INTEGER, {names})")
        rows = [(i, *row) for i, row in enumerate(x.tolist())]
        lite.executemany(f"INSERT INTO {quoted(table)} VALUES ({', '.join('?' * (1 + len(columns)))})", rows)
        query = to_sql(tree, style="sqlite", table=table)
        assert (answered(lite, query, tree.n_features) == expected).all()
        assert lite.execute(f"SELECT count(*) FROM {quoted(table)}").fetchone() == (300,)


def test_a_column_that_is_not_there_is_an_error(database):
    tree = trees()["trained"]
    for connection, style in ((sqlite3.connect(":memory:"), "sqlite"), (database, "postgresql")):
        connection.execute("CREATE TABLE observations (id integer)")
        with pytest.raises(Exception, match=r"column.*pole angular velocity"):
            connection.execute(to_sql(tree, style=style))
        connection.close()


def test_unknown_numbers_go_right(database):
    tree = trees()["one comparison"]
    columns = ["a", "b", "c"]
    fill(database, columns, np.zeros((1, 3)))
    database.execute("UPDATE observations SET a = NULL, b = NULL, c = NULL")
    assert answered(database, to_sql(tree, columns=columns), 3)[0, 0] == tree.predict([np.nan] * 3)


def test_names_of_columns_are_the_features_where_they_can_be():
    assert column_names(["pole angle", "Speed", "speed", "", "x1", "a\nb", "é" * 32, "é" * 31]) == [
        "pole angle", "x1", "x2", "x3", "x4", "x5", "x6", "é" * 31,
    ]  # fmt: skip
    for name in HOSTILE_NAMES:
        (column,) = column_names([name])
        assert column in (name, "x0")


@pytest.mark.parametrize("name", ["", "a\0b", "a\nb", "é" * 32, "\ud800"])
def test_names_that_cannot_be_are_refused(name):
    with pytest.raises(ValueError, match="a name in SQL must have 1 to 63 bytes"):
        to_sql(trees()["trained"], table=name)


def test_the_number_of_columns_is_checked():
    with pytest.raises(ValueError, match="expected the columns of 4 features"):
        to_sql(trees()["trained"], columns=["a"])


def test_a_continuous_action_is_real(database):
    tree = DecisionTree.from_complete(
        np.array([0]),
        np.zeros(1),
        np.array([[1.0], [0.1]]),
        actions=BoxActions(-1, 1, (1,)),
        feature_names=["x"],
    )
    fill(database, ["x"], np.array([[-1.0], [1.0]]))
    rows = database.execute(
        f"SELECT pg_typeof(action_0)::text, action_0 FROM ({to_sql(tree).rstrip().rstrip(';')}) AS q"
    )
    assert rows.fetchall() == [("real", 1.0), ("real", pytest.approx(0.1))]


@pytest.mark.parametrize(
    ("features", "label"),
    [
        (("speed", "height"), "action"),
        (("action", "speed"), "tree_action"),
        (("Action", "tree_action"), "tree_action_2"),
        (("action", "TREE_ACTION", "tree_action_2"), "tree_action_3"),
    ],
)
def test_the_answer_is_called_as_no_feature_is(features, label):
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.0]), np.eye(2), actions=DiscreteActions(2), feature_names=features
    )
    with contextlib.closing(sqlite3.connect(":memory:")) as lite:
        lite.execute(f"CREATE TABLE observations ({', '.join(f'{quoted(name)} REAL' for name in features)})")
        lite.execute(f"INSERT INTO observations VALUES ({', '.join('5' for _ in features)})")
        query = to_sql(tree, style="sqlite").rstrip().rstrip(";")
        found = lite.execute(f"SELECT * FROM ({query})")
        assert [column[0] for column in found.description] == [*features, label]
        assert lite.execute(f"SELECT {label} FROM ({query})").fetchone() == (1,)


def test_several_answers_are_called_as_no_feature_is(pendulum):
    tree = DecisionTree.from_complete(
        np.array([0]),
        np.array([0.0]),
        np.array([[0.25, 0.5], [-0.25, -0.5]]),
        actions=BoxActions(-1, 1, (2,)),
        feature_names=["x", "action_1"],
    )
    assert "AS tree_action_0" in to_sql(tree)
    assert "AS tree_action_1" in to_sql(tree)
    assert "AS action_0" in to_sql(pendulum)
