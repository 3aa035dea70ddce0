"""Trees out of run folders and files, for commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sympol.cli.tree_io import spec_from, tree_from
from sympol.runs.metadata import RunError
from sympol.trees import DecisionTree, DiscreteActions

LISTING = "pole angle (rad) <= 0.02\n  yes: push left\n  no: push right\n"
HEADED = f'+++\nenv = "CartPole-v1"\n+++\n{LISTING}'


@pytest.fixture
def tree() -> DecisionTree:
    return DecisionTree.from_text(
        LISTING,
        actions=DiscreteActions(2, ("push left", "push right")),
        feature_names=["x", "v", "pole angle (rad)", "w"],
        meta={"env": "CartPole-v1"},
    )


def test_files_are_read_by_their_endings(tree: DecisionTree, tmp_path: Path):
    (tmp_path / "policy.json").write_text(tree.to_json())
    (tmp_path / "tree.txt").write_text(LISTING)
    assert tree_from(tmp_path / "policy.json") == tree
    assert tree_from(tmp_path / "tree.txt") == tree
    assert spec_from(tmp_path / "tree.txt", tree).name == "CartPole-v1"


def test_a_listing_may_name_its_environment(tmp_path: Path):
    (tmp_path / "mine.txt").write_text(HEADED)
    tree = tree_from(tmp_path / "mine.txt")
    assert tree.feature_names[0] == "cart position (m)"
    assert tree.feature_high[0] == np.float32(4.8)
    assert spec_from(tmp_path / "mine.txt", tree).name == "CartPole-v1"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", None, "there is no .*a.json; give a run's folder"),
        ("a.json", "{", "a.json cannot be read: not JSON"),
        ("folder", None, "there is no run in .*folder"),
        (
            "a.txt",
            LISTING,
            "nothing says which features and actions .*a.txt is about: begin it with a header",
        ),
        (
            "a.txt",
            HEADED.replace("left", "lefft"),
            "a.txt cannot be read: line 5: unknown action 'push lefft'",
        ),
        ("a.txt", HEADED.replace("CartPole", "CartPol"), "acts on 'CartPol-v1', which is not known here"),
        ("a.txt", HEADED.replace("CartPole", "os:CartPole"), "have no code imported"),
        ("a.txt", "+++\nenv = 3\n+++\nx", "names the environment 3"),
        ("a.txt", b"\xff", "cannot be read"),
    ],
)
def test_what_holds_no_tree_is_said(tmp_path: Path, name: str, content: str | bytes | None, message: str):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RunError, match=message):
        tree_from(path)


def test_where_a_tree_acts_has_to_be_said(tree: DecisionTree, tmp_path: Path):
    for meta, message in [
        ({}, 'in no run\'s folder, and its "meta" has no "env"'),
        ({"env": "os:Evil-v0"}, "have no code imported"),
        ({"env": "Acrobot-v1"}, "looks at 4 features, but Acrobot-v1 has 6"),
    ]:
        other = replace(tree, meta=meta)
        with pytest.raises(RunError, match=message):
            spec_from(tmp_path / "policy.json", other)
