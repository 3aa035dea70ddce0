"""The tables are the paper's, their cells can be made, and the paper's numbers are found."""

from __future__ import annotations

import dataclasses

import pytest

from sympol.algorithms.config import Config
from sympol.algorithms.presets import preset
from sympol.bench.record import Cell
from sympol.bench.tables import (
    CONTROL,
    MEAN,
    METHODS,
    OUR_VARIANTS,
    RUNTIME_VARIANTS,
    SHORT,
    TABLES,
    VARIANT_LABELS,
    VARIANTS,
    Table,
    method_or_label,
    paper_number,
)


def test_all_tables_of_the_issue_are_there():
    assert [*TABLES] == [
        "control-ppo", "control-a2c", "ppo-vs-a2c", "minigrid", "information-loss", "viper-control", "viper-minigrid",
        "tree-size", "ablation", "runtime", "training-curves",
    ]  # fmt: skip


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.name)
def test_teachers_come_first_and_nothing_impossible(table):
    cells = table.cells()
    assert len({*cells}) == len(cells)
    for i, cell in enumerate(cells):
        teacher = method_or_label(cell.method).teacher
        assert teacher is None or cell._replace(method=teacher) not in cells[i:]
        assert not (
            cell.method.startswith("viper")
            and cell.environment in ("Pendulum-v1", "MountainCarContinuous-v0")
        )


@pytest.mark.parametrize("table", TABLES.values(), ids=lambda table: table.name)
def test_every_cell_s_training_is_a_config(table):
    for cell in table.cells():
        method = method_or_label(cell.method)
        found = preset(cell.environment, method.preset, policy=method.policy, algorithm=cell.algo)
        overrides = VARIANTS.get(cell.variant, {})
        Config.from_dict(found | {"policy": method.policy, "algorithm": cell.algo} | overrides)


def test_variants_change_one_thing_of_the_config():
    fields = {field.name for field in dataclasses.fields(Config)}
    assert VARIANT_LABELS.keys() == VARIANTS.keys()
    assert all(overrides.keys() <= fields for overrides in VARIANTS.values())
    for name in OUR_VARIANTS:
        [(field, value)] = VARIANTS[name].items()
        for env in CONTROL:
            assert Config.from_dict(preset(env, "paper")).to_dict()[field] != value, (env, name)


def test_teachers_are_methods():
    assert {method.teacher for method in METHODS.values()} <= {None, *METHODS}
    assert all(METHODS[m.teacher].policy == m.policy for m in METHODS.values() if m.teacher)
    assert method_or_label("mine").label == "mine"


def test_a_table_takes_anybody_s_environment_and_method():
    table = TABLES["control-a2c"].with_(environments=["my/Maze-v0"], methods=["mine", "tree"])
    assert table.environments[-1] == "my/Maze-v0"
    assert [row.method for row in table.rows].count("tree") == 1
    assert Cell("my/Maze-v0", "a2c", "mine") in table.cells()
    assert isinstance(table, Table)


@pytest.mark.parametrize(
    ("quantity", "cell", "number"),
    [
        ("return", ("LunarLander-v3", "ppo", "tree"), -57),
        ("return", ("LunarLander-v3", "a2c", "sa-dt-8"), -367),
        ("return", ("MiniGrid-LavaGapS7-v0", "ppo", "mlp"), 0.76),
        ("return", ("Acrobot-v1", "ppo", "viper-5"), -77),
        ("return", ("Pendulum-v1", "ppo", "viper-5"), None),
        ("return", ("Pendulum-v1", "ppo", "tree-paper", "static-batch"), -434.4),
        ("return", (MEAN, "ppo", "tree-paper", "adam"), 0.865),
        ("return", ("CartPole-v1", "ppo", "tree-paper"), 500),
        ("validation", ("Pendulum-v1", "ppo", "sa-dt-5"), -169),
        ("cohens_d", ("Pendulum-v1", "ppo", "sa-dt-5"), 13.12),
        ("cohens_d", (MEAN, "ppo", "tree"), -0.019),
        ("nodes", ("MountainCarContinuous-v0", "ppo", "d-sdt"), 3),
        ("seconds", ("LunarLander-v3", "ppo", "tree-paper", "runtime"), 402.3),
        ("return", ("my/Maze-v0", "ppo", "mine"), None),
    ],
)
def test_the_paper_s_numbers(quantity, cell, number):
    assert paper_number(quantity, Cell(*cell)) == number


def test_the_paper_has_every_cell_of_its_tables():
    ours = {
        cell
        for name in TABLES
        for cell in TABLES[name].cells()
        if cell.variant not in (*OUR_VARIANTS, *RUNTIME_VARIANTS)
    }
    assert [cell for cell in ours if paper_number("return", cell) is None] == []
    assert {cell.environment for cell in ours} == {*SHORT}
    assert all(paper_number("nodes", cell) for cell in TABLES["tree-size"].cells())
    runtimes = [cell for cell in TABLES["runtime"].cells() if cell.variant == "runtime"]
    assert all(paper_number("seconds", cell) for cell in runtimes)
    assert all(paper_number("validation", cell) is not None for cell in TABLES["information-loss"].cells())
