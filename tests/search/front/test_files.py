"""A front as a folder."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from sympol.envs.registry import resolve
from sympol.evaluate import evaluate_policy
from sympol.play import play
from sympol.runs.metadata import RunError
from sympol.runs.run import Run
from sympol.search.front.files import load_front, point_folder, save_front
from sympol.search.front.front import EvaluatedCandidate, Front, FrontError, Point
from sympol.trees import DecisionTree

from ...tiny import refused, status_of
from .synthetic import chain, front, ladder, point, steady

SPEC = resolve("CartPole-v1")


def played() -> Front:
    """A front of two trees that really played."""
    points = []
    for nodes, tree in ((3, chain(3)), (5, steady())):
        returns = play(tree, SPEC, 4, seed=nodes, purpose="validation").returns
        tested = play(tree, SPEC, 4, seed=7).returns
        points.append(Point.of(tree, returns, method="by hand", seed=3, test_returns=tested))
    tried = (EvaluatedCandidate(9, 1 / 3, "by hand"),)
    return front(points, seed=3, candidates=tried, budget={"seconds": 300})


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("front") / "deep" / "cp"
    run = played()
    save_front(run, folder, SPEC)
    return folder, run


def test_what_is_read_is_what_was_written(saved):
    folder, run = saved
    assert load_front(folder) == run
    assert sorted(path.name for path in (folder / "points").iterdir()) == ["003-nodes", "005-nodes"]


def test_a_front_of_an_earlier_version_is_read_under_present_names(tmp_path):
    budget = {"budget": "2m", "methods": ["scratch", "teacher"], "max_nodes": 7}
    tried = (EvaluatedCandidate(3, 1.0, "tabular"), EvaluatedCandidate(5, 2.0, "by hand"))
    points = [point(1, 1, method="tabular + prune"), point(3, 2, method="teacher + fine-tune + prune")]
    run = front(points, candidates=tried, budget=budget)
    save_front(run, tmp_path, SPEC)
    content = json.loads((tmp_path / "front.json").read_text())
    for fields in (content, *content["points"]):
        fields["spent"] = fields.pop("cost")
    for fields, method in zip(
        content["points"], ("lookup + shrink", "teacher + polish + shrink"), strict=True
    ):
        fields["road"] = method
        del fields["method"]
    content["budget"]["roads"] = content["budget"].pop("methods")
    content["candidates"][0][2] = "lookup"
    (tmp_path / "front.json").write_text(json.dumps(content))
    assert load_front(tmp_path) == run


def test_a_point_is_a_run_that_earns_again_what_it_earned(saved):
    folder, run = saved
    for found in run.points:
        opened = Run.open(point_folder(folder, found))
        assert opened.load_tree() == found.tree
        mean, std = evaluate_policy(opened.load_tree(), opened.resolve_env(), 4, seed=7)
        assert mean == found.test.mean
        np.testing.assert_allclose(std * np.sqrt(4 / 3), found.test.std)
    assert run.points[1].test.mean > 400


@pytest.mark.parametrize("command", ["show", "export", "eval", "verify"])
def test_commands_take_a_point(saved, capsys, command):
    folder, _ = saved
    more = {"export": ["--to", "python"], "eval": ["--episodes", "2"]}.get(command, [])
    assert status_of(command, folder / "points" / "005-nodes", *more) == 0
    assert "push right" in capsys.readouterr().out or command == "eval"


def test_a_point_has_no_training_to_resume(saved, capsys):
    folder, _ = saved
    assert "no training" in refused(capsys, "resume", folder / "points" / "005-nodes")


def test_saved_again_the_old_points_go_and_other_things_stay(tmp_path):
    save_front(front([point(1, 1), point(3, 2)]), tmp_path, SPEC)
    (tmp_path / "plan.json").write_text("{}")
    (tmp_path / "points" / "007-nodes").mkdir()
    (tmp_path / "points" / "007-nodes" / "mine.txt").write_text("mine")
    new = front([point(3, 5), point(5, 9)])
    save_front(new, tmp_path, SPEC)
    assert load_front(tmp_path) == new
    names = {path.name for path in (tmp_path / "points").iterdir()}
    assert names == {"003-nodes", "005-nodes", "007-nodes"}
    assert (tmp_path / "plan.json").exists()


def test_what_is_no_point_is_not_replaced(tmp_path):
    (tmp_path / "points" / "001-nodes").mkdir(parents=True)
    (tmp_path / "points" / "001-nodes" / "mine.txt").write_text("mine")
    with pytest.raises(RunError, match="not a sympol run"):
        save_front(front([point(1, 1)]), tmp_path, SPEC)
    with pytest.raises(FrontError, match=r"there is no .*front\.json"):
        load_front(tmp_path)


def test_a_budget_that_is_not_plain_is_refused(tmp_path):
    with pytest.raises(ValueError, match="plain values"):
        save_front(replace(ladder(), budget={"seconds": object()}), tmp_path, SPEC)


@pytest.fixture
def small(tmp_path):
    save_front(front([point(1, 1), point(3, 2)]), tmp_path, SPEC)
    return tmp_path


def _changed(change):
    def damage(text: str) -> str:
        content = json.loads(text)
        change(content)
        return json.dumps(content)

    return damage


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "",
        lambda text: text[:-20],
        lambda text: "[" * 100_000,
        lambda text: text.replace('"mean": 2.0', '"mean": NaN'),
        lambda text: text.replace('"mean": 2.0', '"mean": 1e999'),
        lambda text: "[]",
        _changed(lambda c: c.update(version=2)),
        _changed(lambda c: c.pop("seed")),
        _changed(lambda c: c.update(seed="0")),
        _changed(lambda c: c.update(more=1)),
        _changed(lambda c: c.update(budget=[])),
        _changed(lambda c: c.update(commit=None)),
        _changed(lambda c: c.update(points=[])),
        _changed(lambda c: c.update(points=7)),
        _changed(lambda c: c.update(candidates=[[1, 2]])),
        _changed(lambda c: c["points"].reverse()),
        _changed(lambda c: c["points"][0].update(nodes=3)),
        _changed(lambda c: c["points"][0].update(nodes="../../001")),
        _changed(lambda c: c["points"][0].update(nodes=True)),
        _changed(lambda c: c["points"][0].update(method=3)),
        _changed(lambda c: c["points"][0]["validation"].update(mean=9)),
        _changed(lambda c: c["points"][0]["cost"].update(env_steps=-1)),
        _changed(lambda c: c["points"][0].pop("sha256")),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(small, damage):
    file = small / "front.json"
    file.write_text(damage(file.read_text()))
    with pytest.raises(FrontError, match=r"front\.json") as error:
        load_front(small)
    assert "\n" not in str(error.value)


def test_a_tree_that_was_changed_is_not_what_was_measured(small):
    policy = small / "points" / "003-nodes" / "policy.json"
    tree = DecisionTree.from_json(policy.read_text())
    policy.write_text(replace(tree, threshold=tree.threshold + np.float32(tree.feature == 0)).to_json())
    with pytest.raises(FrontError, match="is not the tree"):
        load_front(small)
    policy.unlink()
    with pytest.raises(FrontError, match="cannot be read"):
        load_front(small)
