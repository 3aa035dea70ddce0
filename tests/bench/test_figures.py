"""Plots show what the records hold, and are the same file each time."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sympol.bench.figures import figures, mean_and_std, write_figures
from sympol.bench.record import Cell
from sympol.bench.summary import by_cell
from sympol.bench.tables import METHODS, TABLES, Table
from sympol.results.style import style_of

from .synthetic import record


def small(name: str) -> Table:
    return dataclasses.replace(TABLES[name], environments=("CartPole-v1", "Pendulum-v1"))


def run(table: Table):
    return by_cell(record(cell) for cell in table.cells())


def test_a_band_is_over_trainings():
    cell = Cell("CartPole-v1", "ppo", "tree")
    curves = [
        {"timesteps": [10, 20, 30], "returns": [0, 1, 2]},
        {"timesteps": [15, 20, 25], "returns": [2, 3, 4]},
    ]
    of = mean_and_std(record(cell, trainings=2, curves=curves))
    assert of is not None
    assert of.timesteps.tolist() == [15, 20, 25]
    np.testing.assert_allclose(of.mean, [1.25, 2, 2.75])
    assert of.std is not None
    np.testing.assert_allclose(of.std, np.std([[0.5, 1, 1.5], [2, 3, 4]], axis=0, ddof=1))
    one = mean_and_std(record(cell, trainings=1, curves=curves[:1]))
    assert one is not None
    assert one.std is None
    assert mean_and_std(record(cell, curves=None)) is None
    apart = [{"timesteps": [1, 2], "returns": [0, 1]}, {"timesteps": [3, 4], "returns": [0, 1]}]
    assert mean_and_std(record(cell, trainings=2, curves=apart)) is None


def test_curves_have_their_tests_dashed():
    table = small("training-curves")
    made = figures(table, run(table))
    assert [*made] == ["full", "pairs"]
    assert len(made["full"].axes) == 3
    assert made["full"].axes[2].axison is False
    lines = {str(line.get_label()) for line in made["full"].axes[1].lines}
    assert lines == {"SYMPOL", "SYMPOL, test", "MLP", "MLP, test", "SDT", "SDT, test"}
    assert len(made["pairs"].axes) == 2 * 3
    pair = {str(line.get_label()): line for line in made["pairs"].axes[5].lines}
    assert {*pair} == {"SYMPOL", "SYMPOL, test", "SDT (teacher)", "D-SDT, test"}
    returns = np.array(record(Cell("Pendulum-v1", "ppo", "d-sdt")).returns)
    assert pair["D-SDT, test"].get_ydata()[0] == pytest.approx(returns.mean(axis=1).mean())  # pyright: ignore
    assert pair["D-SDT, test"].is_dashed()
    assert not pair["SYMPOL"].is_dashed()


@pytest.mark.parametrize(
    "name", [name for name in TABLES if name not in ("ppo-vs-a2c", "runtime", "training-curves")]
)
def test_nothing_run_draws_nothing_and_some_run_something(name):
    table = small(name) if "minigrid" not in name else TABLES[name]
    assert figures(table, {}) == {}
    assert len(figures(table, run(table))) == 1


def test_the_same_records_the_same_file(tmp_path):
    table = small("tree-size")
    [path] = write_figures(table, run(table), tmp_path)
    assert path.name == "tree-size-nodes.svg"
    before = path.read_bytes()
    assert write_figures(table, run(table), tmp_path) == [path]
    assert path.read_bytes() == before
    assert b"<dc:date>" not in before


def test_looks_differ():
    methods = [method for method in METHODS if not method.endswith("-paper")]
    assert len({(style_of(m).colour, str(style_of(m).line)) for m in methods}) == len(methods)
    assert len({style_of(m).marker for m in methods}) == len(methods)
    assert style_of("tree-paper") == style_of("tree")
    mine = ["a", "b", "c", "d"]
    assert len({style_of(m, mine)[:2] for m in mine}) == 4
