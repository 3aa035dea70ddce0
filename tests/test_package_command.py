"""``sympol export --to package``: a folder that installs."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from sympol.algorithms.config import Config
from sympol.cli.app import main
from sympol.envs.registry import resolve
from sympol.runs.run import Run
from sympol.trees import DecisionTree, DiscreteActions


@pytest.fixture
def tree() -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([2]),
        np.array([0.25]),
        np.eye(2),
        actions=DiscreteActions(2, ("push left", "push right")),
        feature_names=["cart position", "cart velocity", "pole angle", "pole angular velocity"],
    )


@pytest.fixture
def source(tree: DecisionTree, tmp_path: Path) -> Path:
    (tmp_path / "policy.json").write_text(tree.to_json(), encoding="utf-8")
    return tmp_path / "policy.json"


def status(*arguments: object) -> int:
    try:
        return main(["export", *map(str, arguments)])
    except SystemExit as stop:
        return int(str(stop.code))


def test_a_file_becomes_a_package_called_as_its_folder(source, tree, tmp_path, capsys):
    folder = tmp_path / "My-Policy"
    assert status(source, "--to", "package", "--out", folder) == 0
    assert f"pip install {folder}" in capsys.readouterr().err.replace("\n", "")
    act = runpy.run_path(str(folder / "src/my_policy/policy.py"))["act"]
    assert [act([0, 0, x, 0]) for x in (0.25, 0.3)] == tree.predict(
        [[0, 0, 0.25, 0], [0, 0, 0.3, 0]]
    ).tolist()
    assert status(source, "--to", "package", "--out", tmp_path / "other", "--name", "pole") == 0
    assert (tmp_path / "other/src/pole/py.typed").is_file()


def test_a_run_says_where_it_is_from(tree, tmp_path):
    run = Run.create(tmp_path / "run", resolve("CartPole-v1"), Config(), seed=0)
    (run.path / "policy.json").write_text(tree.to_json(), encoding="utf-8")
    assert status(run.path, "--to", "package", "--out", tmp_path / "made") == 0
    readme = (tmp_path / "made/README.md").read_text("utf-8")
    said = json.loads(readme.split("## Where it is from")[1].strip().strip("`").removeprefix("text"))
    assert (said["env"], said["seed"], said["preset"]) == ("CartPole-v1", 0, "default")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "a package is a folder: say which, as in --out my_policy"),
        (["--out", "."], "is there already; choose another --out"),
        (["--out", "policy.json"], "is there already; choose another --out"),
        (["--out", "json"], "'json' is the name of another module"),
        (["--out", "3d"], "a package's name must be a lower-case word"),
        (["--out", "ok", "--check"], "a package takes no --style or --check"),
        (["--out", "policy.json/under"], "cannot write policy.json/under"),
    ],
)
def test_what_is_wrong_is_said_in_a_line(source, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert status(source, "--to", "package", *arguments) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "ok").exists()
