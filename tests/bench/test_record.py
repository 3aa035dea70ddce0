"""A record comes back as it was written, and says what is wrong with one that cannot be."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from sympol.bench.methods import same_config
from sympol.bench.record import Cell, Record, RecordError, load, load_all, to_json

from .synthetic import record

CELL = Cell("Acrobot-v1", "ppo", "tree")


def test_a_record_comes_back(tmp_path):
    one = record(CELL)
    path = one.save(tmp_path)
    assert path == tmp_path / "results/cells/Acrobot-v1/ppo-tree.json"
    again = load(path)
    assert again.cell == CELL
    assert (again.config, again.versions, again.nodes, again.seeds) == (
        one.config,
        one.versions,
        one.nodes,
        one.seeds,
    )
    for name in ("returns", "validation_returns", "sampled_returns", "seconds"):
        np.testing.assert_allclose(getattr(again, name), getattr(one, name), rtol=1e-6)
    assert again.curves is not None
    assert one.curves is not None
    assert again.curves[2]["timesteps"] == one.curves[2]["timesteps"]
    assert load(again.save(tmp_path)) == again  # what was rounded stays
    assert list(tmp_path.rglob("*.tmp")) == []


def test_a_training_is_a_line():
    text = to_json(record(CELL))
    lines = text.splitlines()
    assert lines[lines.index(' "returns": [') + 1].startswith("  [-")
    assert lines[lines.index(' "returns": [') + 6] == " ],"
    assert '  "max_grad_norm": "inf"' in lines
    assert json.loads(text)["returns"][0] == pytest.approx(record(CELL).returns[0], rel=1e-6)


def test_every_cell_has_its_own_file(tmp_path):
    cells = [
        CELL,
        CELL._replace(variant="adam"),
        CELL._replace(algo="a2c"),
        CELL._replace(environment="my/Maze-v0"),
    ]
    paths = {record(cell).save(tmp_path) for cell in cells}
    assert {path.relative_to(tmp_path / "results/cells").as_posix() for path in paths} == {
        "Acrobot-v1/ppo-tree.json", "Acrobot-v1/ppo-tree-adam.json", "Acrobot-v1/a2c-tree.json",
        "my_Maze-v0/ppo-tree.json",
    }  # fmt: skip
    assert {one.cell for one in load_all(tmp_path)} == {*cells}
    with pytest.raises(RecordError, match="another cell"):
        record(Cell("Acrobot-v1", "ppo", "tree-adam")).save(tmp_path)


def test_a_file_in_the_wrong_place_is_found(tmp_path):
    path = record(CELL).save(tmp_path)
    path.rename(path.with_name("ppo-mlp.json"))
    with pytest.raises(RecordError, match=r"whose place is .*ppo-tree\.json; move it"):
        load_all(tmp_path)


def test_partial_cells_and_stale_ones():
    partial = record(CELL, trainings=2)
    assert partial.missing(range(5)) == (2, 3, 4)
    assert same_config(partial.config, {"depth": 7, "max_grad_norm": math.inf, "critic_hidden": (64, 64)})
    assert not same_config(partial.config, {"depth": 6, "max_grad_norm": math.inf, "critic_hidden": (64, 64)})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"returns": [[1.0]] * 4}, r"returns must have 5 rows, one a seed.* got rows of 1, 1, 1, 1"),
        ({"returns": [[1.0], [1.0], [1.0], [1.0], [1.0, 2.0]]}, "of equally many episodes"),
        ({"returns": [[]] * 5}, "got rows of 0, 0"),
        ({"returns": [[math.nan]] * 5}, "returns must be finite"),
        ({"returns": None}, "returns must be given"),
        ({"sampled_returns": [[math.inf]] * 5}, "sampled_returns must be finite"),
        ({"seeds": (0, 1, 2, 3, 3)}, r"each once, got \[0, 1, 2, 3, 3\]"),
        ({"seeds": ()}, "seeds must be some"),
        ({"seeds": (0, 1, 2, 3, 1000)}, r"from 0 to 999, got 1000; those above are for searches"),
        ({"nodes": (3,)}, "nodes must have one number a seed, 5, got 1"),
        ({"seconds": (1, 2, 3, 4, -5)}, "seconds must be finite and not negative"),
        ({"curves": [{"timesteps": [2, 1], "returns": [0, 0]}] * 5}, "rising timesteps"),
        ({"curves": []}, "curves must have one a seed"),
        ({"total_timesteps": 0}, "at least 1"),
        ({"config": {"gamma": math.nan}}, "must not be NaN"),
        ({"extra": {"model": object()}}, "plain values"),
    ],
)
def test_impossible_records(fields, message):
    with pytest.raises(ValueError, match=message):
        record(CELL, **fields)


@pytest.mark.parametrize(
    "cell",
    [
        ("", "ppo", "tree"),
        ("../x", "ppo", "tree"),
        ("A-v0", "dqn", "tree"),
        ("A-v0", "ppo", ""),
        ("A-v0", "ppo", "../tree"),
        ("A-v0", "ppo", "Tree"),
    ],
)
def test_names_that_are_no_cells(cell):
    with pytest.raises(RecordError, match="must be"):
        Record(*cell, total_timesteps=1, seeds=(0,), returns=((0.0,),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not a record"),
        ("[]", "is not a record"),
        ('{"environment": "A-v0"}', "missing"),
        ('{"score": 1}', r"unknown fields \['score'\]"),
        ('{"returns": [[NaN]]}', "NaN is no number"),
    ],
)
def test_files_that_are_no_records(tmp_path, text, message):
    path = tmp_path / "results/cells/A-v0/ppo-tree.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(RecordError, match=message) as error:
        load_all(tmp_path)
    assert str(path) in str(error.value)
    assert "run its cell again" in str(error.value)
