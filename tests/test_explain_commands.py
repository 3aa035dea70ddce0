"""sympol explain and sympol diff, on trees that were written by hand."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from sympol.cli.tree_io import tree_from
from sympol.envs.registry import resolve
from sympol.play import play
from sympol.trees.edit import set_threshold

from .tiny import refused, status_of

BALANCE = """+++
env = "CartPole-v1"
+++
pole angular velocity <= 0
  yes: push left
  no: push right
"""
DOOR = """+++
features = [{name = "front is wall", low = 0, high = 1}, {name = "front is lava", low = 0, high = 1}, "speed"]
groups = [{name = "front", features = [0, 1], categories = ["wall", "lava"]}]
actions = ["turn", "go", "wait"]
+++
front is lava
  yes: turn
  no: speed > 1
    yes: wait
    no: go
"""


@pytest.fixture
def balance(tmp_path: Path) -> Path:
    path = tmp_path / "balance.txt"
    path.write_text(BALANCE)
    return path


@pytest.fixture
def door(tmp_path: Path) -> Path:
    path = tmp_path / "door.txt"
    path.write_text(DOOR)
    return path


def test_explain_says_why_and_what_else(door: Path, capsys: pytest.CaptureFixture[str]):
    assert status_of("explain", door, "--observation", "1", "0", "-1e-3") == 0
    assert capsys.readouterr().out.splitlines() == [
        "go, because front is wall and speed ≤ 1.",
        "front is wall and speed = -0.001 together force it.",
        "turn, if front is lava instead of wall.",
        "wait, if speed = 1.0000001 instead of -0.001.",
    ]


def test_features_and_categories_are_named(door: Path, capsys: pytest.CaptureFixture[str]):
    words = ["--observation", "front=lava", "speed=-2", "--immutable", "speed", "--norm", "l0", "--json"]
    assert status_of("explain", door, *words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["observation"] == [0, 1, -2]
    assert found["answer"] == "turn"
    assert found["reason"] == {"features": ["front"], "words": "front is lava"}
    assert [(one["answer"], one["distance"]) for one in found["counterfactuals"]] == [
        ("go", 1),
        ("wait", None),
    ]


def test_scales_decide_what_is_near(door: Path, capsys: pytest.CaptureFixture[str]):
    for scale, nearest in (("speed=0.1", "turn"), ("speed=100", "wait")):
        assert status_of("explain", door, "--observation", "1", "0", "0", "--scale", scale) == 0
        assert capsys.readouterr().out.splitlines()[2].startswith(nearest)


def test_a_step_of_an_episode_is_explained(balance: Path, capsys: pytest.CaptureFixture[str]):
    tree = tree_from(balance)
    seen = play(tree, resolve("CartPole-v1"), 1, seed=3).observations
    assert status_of("explain", balance, "--episode", "3", "--step", "5", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    np.testing.assert_array_equal(np.float32(found["observation"]), seen[5])
    assert found["action"] == tree.predict(seen[5])


def test_diff_tells_what_was_edited_and_counts(
    balance: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    tree = tree_from(balance)
    edited = tmp_path / "edited.json"
    edited.write_text(set_threshold(tree, 0, 0.5).to_json())
    assert status_of("diff", balance, edited, "--episodes", "3", "--seed", "1") == 0
    said = capsys.readouterr().out.splitlines()
    name = "pole angular velocity (rad/s)"
    assert said[:2] == ["3 nodes, then 3", f"Everywhere: “{name} ≤ 0” becomes “{name} ≤ 0.5”."]
    x = play(tree, resolve("CartPole-v1"), 3, seed=1).observations
    changed = int(((x[:, 3] > 0) & (x[:, 3] <= 0.5)).sum())
    assert said[2].startswith(f"{changed:,} of {len(x):,} states get another action")
    assert status_of("diff", balance, edited, "--json") == 0
    assert json.loads(capsys.readouterr().out)["acts_alike"] is False
    assert status_of("diff", balance, balance) == 0
    assert "act alike" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give either --observation or --episode"),
        (["--observation", "1", "--episode", "3"], "give either --observation or --episode"),
        (["--observation", "1", "2"], r"expected observations of shape \[4\]"),
        (["--observation", "1", "2", "3", "nan"], "must be finite, got nan"),
        (["--observation", "1", "2", "3", "x"], "--observation must be a number, got 'x'"),
        (["--observation", "pole angel=1"], "unknown feature 'pole angel'; did you mean 'pole angle"),
        (["--observation", "pole angle=1", "2"], "all numbers or all NAME=VALUE, got '2'"),
        (["--observation", "pole angle=x"], "the value of 'pole angle' must be a number, got 'x'"),
        (["--observation", "0", "0", "0", "0", "--scale", "3"], "--scale must be of the form NAME=NUMBER"),
        (["--observation", "0", "0", "0", "0", "--scale", "pole angle=-3"], "must be positive and finite, got -3"),
        (["--observation", "0", "0", "0", "0", "--immutable", "x"], "unknown feature 'x'; there are"),
        (["--observation", "0", "0", "0", "0", "--norm", "l2"], "invalid choice 'l2'"),
        (["--episode", "3", "--step", "500"], r"--step must be from 0 to \d+ in the episode of seed 3, got 500"),
        (["--episode", "-3"], "--episode and --step must not be negative"),
    ],
)  # fmt: skip
def test_what_cannot_be_explained_is_one_line(
    balance: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
):
    assert re.search(message, refused(capsys, "explain", balance, *words))


def test_what_cannot_be_compared_is_one_line(
    balance: Path, door: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "must be of the same features" in refused(capsys, "diff", balance, door)
    assert "must not be negative" in refused(capsys, "diff", balance, balance, "--episodes", "-1")
    assert "nothing says where the tree" in refused(capsys, "diff", door, door, "--episodes", "1")
    assert "there is no run in" in refused(capsys, "diff", balance, tmp_path / "nothing")
    assert "unknown category 'lavva'; did you mean 'lava'?" in refused(
        capsys, "explain", door, "--observation", "front=lavva"
    )
