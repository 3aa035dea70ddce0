"""``sympol train --start``: from a run, a file, or what was distilled; and what is wrong with it in one line."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympol
from sympol import DecisionTree
from sympol.cli.train import parse_train
from sympol.runs.metadata import RunError
from sympol.trees.edit import graft

from .algorithms.test_start import RIGHT, TREE, hand_written
from .runs.test_interrupted import MANY, assert_same, newest, wait_for_saves
from .tiny import TRAIN, flags, quick_compiles, read_summary, refused, start, status_of
from .trees.samples import HOSTILE_NAMES, telling_observations

__all__ = ["quick_compiles"]


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    path = tmp_path / "hand.json"
    path.write_text(TREE.to_json())
    return path


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("first") / "run"
    assert status_of("train", *TRAIN, "--run-dir", run) == 0
    return run


def same_actions(tree: DecisionTree, other: DecisionTree) -> None:
    x = telling_observations(tree, np.random.default_rng(0), 2000)
    inside = x[((x >= tree.feature_low) & (x <= tree.feature_high)).all(axis=1)]
    np.testing.assert_array_equal(tree.predict(inside), other.predict(inside))


def tree_of(path: Path) -> DecisionTree:
    return DecisionTree.from_json(path.read_text())


def test_from_a_run_its_return_is_told(first, tmp_path, capsys):
    run = tmp_path / "on"
    assert status_of("train", *TRAIN, "--start", first, "--seed", "3", "--run-dir", run, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == read_summary(run)
    earned = read_summary(first)["return_mean"]
    assert summary["start"] == {
        "origin": str(first),
        "return_mean": earned,
        "freeze": [],
        "confidence": 0.7,
        "critic_warmup": 0.05,
    }
    same_actions(tree_of(first / "policy.json"), tree_of(run / "start.json"))
    assert (
        len((run / "metrics.csv").read_text().splitlines()) == 1 + 1 + 8
    )  # the tree itself is validated, too


@pytest.mark.parametrize(
    "frozen", [["--freeze-nodes", "0", "4"], ["--freeze", "pole angle > 0.05"]], ids=["nodes", "condition"]
)
def test_from_a_file_with_a_rule_that_stays(hand, tmp_path, frozen):
    run = tmp_path / "run"
    words = ["train", *TRAIN, "--start", hand, *frozen, "--critic-warmup", "0"]
    assert status_of(*words, "--run-dir", run) == 0
    tree = tree_of(run / "policy.json")
    assert (tree.feature[0], tree.threshold[0]) == (2, np.float32(0.03))
    x = telling_observations(TREE, np.random.default_rng(0), 2000)
    assert (tree.predict(x[x[:, 2] > np.float32(0.03)]) == 1).all()
    again = sympol.load(run)
    assert again.start is not None
    assert again.start.freeze == RIGHT


@pytest.mark.slow
def test_from_what_was_distilled(tmp_path):
    teacher, distilled, run = (tmp_path / name for name in ("teacher", "distilled", "run"))
    mlp = {"total_timesteps": 2048, "num_envs": 4, "num_steps": 16, "num_evals": 2, "actor_hidden": (8,)}
    few = ["--eval-episodes", "2"]
    words = ["--policy", "mlp", *flags(mlp), "--critic-hidden", "8", *few, "--run-dir", str(teacher)]
    assert status_of("train", "CartPole-v1", *words) == 0
    once = ["--episodes", "2", "--iterations", "1", "--depth", "2", *few]
    assert status_of("distill", teacher, "--method", "dagger", *once, "--out", distilled) == 0
    assert status_of("train", *TRAIN, "--start", distilled, "--run-dir", run) == 0
    same_actions(tree_of(distilled / "policy.json"), tree_of(run / "start.json"))
    assert read_summary(run)["start"]["return_mean"] == read_summary(distilled)["return_mean"]


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def test_begun_from_a_tree_it_is_gone_on_with_only_from_that_tree(hand, tmp_path, capsys):
    run = tmp_path / "run"
    words = ["train", *TRAIN, "--start", str(hand), "--run-dir", str(run)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sympol.cli.learn.finish", interrupt)
        assert status_of(*words) == 130
    capsys.readouterr()
    without = [word for word in words if word not in ("--start", str(hand))]
    assert "was begun with start {'origin'" in refused(capsys, *without, "--resume")
    frozen = refused(capsys, *words, "--freeze-nodes", "0", "--resume")
    assert "'freeze': []" in frozen
    assert "'freeze': [0]" in frozen
    hand.write_text(hand_written(((0, 1), (0, 1), (0, 1))).to_json())
    assert f"another tree in {hand}" in refused(capsys, *words, "--resume")
    hand.write_text(TREE.to_json())
    assert status_of(*words, "--resume") == 0


def test_the_depth_is_the_presets_or_the_trees(tmp_path, hand, capsys):
    deep = tmp_path / "deep.json"
    tree = TREE
    for leaf in range(2, 12, 2):
        tree = graft(tree, leaf, TREE)
    deep.write_text(tree.to_json())
    assert tree.depth == 12
    said = refused(
        capsys, "train", "CartPole-v1", "--start", deep, "--depth", "5", "--run-dir", tmp_path / "run"
    )
    assert f"choose --depth {tree.depth}" in said
    assert not (tmp_path / "run").exists()
    said = refused(
        capsys, "train", "CartPole-v1", "--start", deep, "--policy", "sdt", "--run-dir", tmp_path / "run"
    )
    assert "only a tree can start from a tree" in said
    assert parse_train(["CartPole-v1", "--start", str(deep)]).config.depth == 12
    assert parse_train(["CartPole-v1", "--start", str(hand)]).config.depth == 5


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--start", "nowhere"], "there is no run in nowhere"),
        (["--start", "nowhere.json"], "there is no nowhere.json"),
        (["--freeze-nodes", "0"], "--freeze-nodes is about the tree to start from: give --start, too"),
        (["--freeze", "pole angle > 0"], "--freeze is about the tree to start from: give --start, too"),
        (
            ["--start", "HAND", "--freeze-nodes", "9"],
            "numbers of nodes of the tree to start from, 0 to 4, got 9",
        ),
        (["--start", "HAND", "--freeze", "pole angel > 0"], "pole angle"),
        (["--start", "HAND", "--start-confidence", "0.3"], "confidence must be above 0.5"),
        (["--start", "HAND", "--critic-warmup", "1"], "critic_warmup must be from 0 to less than 1"),
        (["--start", "HAND", "--policy", "mlp"], "only a tree can start from a tree"),
    ],
)
def test_bad_input_is_one_line(words, says, hand, tmp_path, capsys):
    words = [str(hand) if word == "HAND" else word for word in words]
    assert says in refused(capsys, "train", "CartPole-v1", *words, "--run-dir", tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", [*HOSTILE_NAMES, "*/", "[bold]x[/]", "'; DROP TABLE trees; --"])
def test_strangers_names_are_refused_in_one_line(name, hand, tmp_path, capsys):
    names = (name, *(f"other {i}" for i in range(3)))
    hand.write_text(hand_written(feature_names=names).to_json())
    said = refused(capsys, "train", "CartPole-v1", "--start", hand, "--run-dir", tmp_path / "run")
    assert "calls feature 0" in said


def test_a_damaged_start_is_told(hand, tmp_path):
    run = tmp_path / "run"
    sympol.PPO("tree", "CartPole-v1", start=TREE).save(run)
    for content in ("{", "", (run / "start.json").read_text().replace('"left"', '"up"')):
        (run / "start.json").write_text(content)
        with pytest.raises(RunError, match="started from a tree, which cannot be read"):
            sympol.load(run)
    (run / "start.json").unlink()
    with pytest.raises(RunError, match=r"start\.json"):
        sympol.load(run)


@pytest.mark.slow
def test_killed_and_resumed_it_ends_in_the_same_tree(hand, tmp_path):
    root, run, whole = Path(__file__).parents[1], tmp_path / "run", tmp_path / "whole"

    def words(path: Path) -> list[Any]:
        return [
            "train",
            "CartPole-v1",
            *MANY,
            "--start",
            str(hand),
            "--freeze-nodes",
            "0",
            "4",
            "--run-dir",
            str(path),
        ]

    assert status_of(*words(whole)) == 0
    for begun in (words(run), ["resume", str(run)]):
        already = newest(run)
        process = start(*begun, folder=root)
        wait_for_saves(process, run, already)
        time.sleep(0.03)
        process.kill()
        process.communicate()
        assert newest(run) > already
    assert status_of("resume", run) == 0
    assert_same(run, whole)


@pytest.mark.slow
def test_a_poor_tree_becomes_a_good_one():
    """Two leaves, which the pole's lean alone decides, earn 41; trained on from there they become a tree of 475."""
    lean = DecisionTree.from_complete(
        np.array([2]), np.float32([0.02]), np.eye(2), actions=TREE.actions, feature_names=TREE.feature_names
    )
    agent = sympol.PPO("tree", "CartPole-v1", start=lean, seed=0, total_timesteps=300_000)
    reached: list[float] = []
    agent.learn(
        callback=lambda report: reached.append(report.metrics["eval/mean_reward"]), progress_bar=False
    )
    assert reached[0] < 60
    mean, _ = sympol.evaluate_policy(agent, "CartPole-v1", n_eval_episodes=50, seed=11)
    assert mean >= 475
