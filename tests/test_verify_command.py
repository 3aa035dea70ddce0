"""``sympol verify`` as it is typed: what is proven, what is said of it, and the exit status that CI reads."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from sympol.envs.registry import resolve
from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.verify import read_properties

from .tiny import quick_compiles, refused, status_of, trained
from .trees.conftest import cartpole, front, pendulum
from .trees.samples import HOSTILE_NAMES

__all__ = ["cartpole", "front", "pendulum", "quick_compiles"]

SAFETY = Path(__file__).parent.parent / "examples" / "safety"

RIGHT = "when pole angle > 0.1 and pole angular velocity > 0.5 then action is push right"
NEVER = "action is never push left"
IMPOSSIBLE = "when pole angle > 1 then action is push left"


@pytest.fixture
def write(tmp_path):
    def written(tree: DecisionTree, name: str = "policy.json") -> str:
        path = tmp_path / name
        path.write_text(tree.to_json(), encoding="utf-8")
        return str(path)

    return written


def test_what_holds_is_status_0_and_what_fails_is_status_1(cartpole, write, capsys):
    path = write(cartpole)
    assert status_of("verify", path, "--property", RIGHT) == 0
    assert capsys.readouterr().out == f"✓ {RIGHT}\n  holds: proven for 1 leaf\n1 of 1 hold\n"
    assert status_of("verify", path, "--property", RIGHT, "--property", NEVER) == 1
    said = capsys.readouterr().out
    assert said.endswith(
        f"✗ {NEVER}\n  fails in 2 of 4 leaves: cart position = 0, cart velocity = 0, pole angle = 0, "
        "pole angular velocity = -0.05: push left\n1 of 2 hold\n"
    )
    assert status_of("verify", path, "--property", IMPOSSIBLE) == 0
    assert capsys.readouterr().out.startswith(f"○ {IMPOSSIBLE}\n  holds vacuously: no observation meets")
    assert status_of("verify", path, "--property", IMPOSSIBLE, "--everywhere") == 1


def test_a_file_of_properties_is_read(cartpole, tmp_path, write, capsys):
    write(cartpole)
    other = tmp_path / "other.toml"
    other.write_text(f'[[property]]\nname = "left?"\nrule = "{NEVER}"\n', encoding="utf-8")
    assert status_of("verify", str(tmp_path / "policy.json"), "--properties", str(other)) == 1
    assert capsys.readouterr().out.startswith("✗ left?\n")
    for path, problem in [(tmp_path / "none.toml", "cannot be read"), (tmp_path, "cannot be read")]:
        assert problem in refused(capsys, "verify", str(tmp_path / "policy.json"), "--properties", str(path))


def test_another_tree_is_the_same_policy_or_not(cartpole, pendulum, write, capsys):
    path = write(cartpole)
    assert status_of("verify", path, "--against", write(cartpole.prune(), "pruned.json")) == 0
    assert capsys.readouterr().out == "✓ equal\n  holds: proven for 4 leaves\n1 of 1 hold\n"
    other = dataclasses.replace(cartpole, value=cartpole.value[:, ::-1])
    assert status_of("verify", path, "--against", write(other, "other.json")) == 1
    assert "pole angular velocity = 0: push right; the other: push left" in capsys.readouterr().out
    assert "see other features" in refused(
        capsys, "verify", path, "--against", write(pendulum, "pendulum.json")
    )


def test_without_a_question_it_says_what_every_action_is_for(cartpole, pendulum, front, write, capsys):
    assert status_of("verify", write(front)) == 0
    said = capsys.readouterr().out
    assert said.startswith("8 leaves; 3 cannot be reached: [")
    assert re.search(r"^  turn right: \d+ lea(f|ves)", said, re.MULTILINE)
    assert "turn left: 1 leaf, only where speed ≤ 0 and front is not lava\n" not in said
    assert status_of("verify", write(pendulum)) == 0
    assert "torque from -2 to 0.53" in capsys.readouterr().out
    assert status_of("verify", write(cartpole)) == 0
    assert "  push right: 2 leaves, only where pole angle > -0.1\n" in capsys.readouterr().out


def test_json_is_one_line_and_strict(cartpole, write, capsys):
    path = write(cartpole)
    assert status_of("verify", path, "--property", NEVER, "--property", RIGHT, "--json") == 1
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    found = json.loads(said, parse_constant=pytest.fail)
    fails, holds = found["properties"]
    assert fails["counterexample"][0]["action"] == "push left"
    assert cartpole.predict(fails["counterexample"][0]["observation"]) == 0
    assert (fails["holds"], fails["leaves"], fails["violating_leaves"]) == (False, 4, 2)
    assert (holds["holds"], holds["vacuous"], holds["counterexample"]) == (True, False, [])
    assert found["unreachable_leaves"] == []
    assert found["features"] == list(cartpole.feature_names)


def test_infinite_counterexamples_are_strings_in_json(write, capsys):
    tree = DecisionTree.from_complete(
        np.array([0]),
        np.array([np.finfo(np.float32).max]),
        np.eye(2),
        actions=DiscreteActions(2),
        feature_names=["x"],
    )
    assert status_of("verify", write(tree), "--property", "action is 0", "--json") == 1
    assert json.loads(capsys.readouterr().out)["properties"][0]["counterexample"][0]["observation"] == ["inf"]


def test_robustness_plays_and_measures(cartpole, write, capsys):
    path = write(cartpole)
    words = ["--robustness", "2", "--noise", "pole angle=0.05", "cart position=1"]
    assert status_of("verify", path, *words) == 0
    said = capsys.readouterr().out
    assert re.search(
        r"^margins over \d+ visited observations, .*: least [\d.e-]+, 1 % .*median [\d.]+$", said, re.M
    )
    assert re.search(r"pole angle ± 0.05, cart position ± 1: the action can change in [\d.]+ % of them", said)
    assert status_of("verify", path, *words, "--json") == 0
    found = json.loads(capsys.readouterr().out)["robustness"]
    assert 0 <= found["margin"]["least"] <= found["margin"]["5 %"] <= found["margin"]["median"]
    assert 0 < found["noise"]["share"] <= 1
    assert set(found["noise"]["by_feature_alone"]) == {"pole angle"}


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["--property", "when pole angel > 0 then action is 1"], "did you mean 'pole angle'"),
        (["--property", "nonsense"], "unknown action 'nonsense'"),
        (["--robustness", "-1"], "1 or more, got -1"),
        (["--noise", "pole angle=0.1"], "give --robustness EPISODES"),
        (["--robustness", "1", "--noise", "pole angle"], "of the form NAME=SIZE"),
        (["--robustness", "1", "--noise", "pole angle=-1"], "of the form NAME=SIZE"),
        (["--robustness", "1", "--noise", "pole angel=1"], "did you mean 'pole angle'"),
        (["--against", "nowhere.json"], "nowhere.json"),
        (["--propertys", "x"], "did you mean --propert"),
    ],
)
def test_bad_input_is_a_line_and_status_2(cartpole, write, capsys, words, problem):
    said = refused(capsys, "verify", write(cartpole), *words)
    assert problem in said
    assert said.count("\n") <= 1


def test_names_of_strangers_stay_on_their_line(write, capsys):
    names = [*HOSTILE_NAMES, "[bold red]", "[/]", "*/"]
    tree = DecisionTree.from_complete(
        np.array([0]),
        np.array([0.5]),
        np.eye(2),
        actions=DiscreteActions(2, (HOSTILE_NAMES[1], "[link=x]go[/]")),
        feature_names=names,
    )
    path = write(tree)
    assert status_of("verify", path, "--property", "action is 1") == 1
    said = capsys.readouterr().out
    assert said.count("\n") == 3
    assert "[bold red] = 0, [/] = 0, */ = 0" in said
    assert "line\\nbreak" in said
    assert status_of("verify", path) == 0
    assert "[link=x]go[/]: 1 leaf, only where quote" in capsys.readouterr().out
    box = dataclasses.replace(
        tree, actions=BoxActions(-1, 1, (2,), ("[bold]", "a\nb")), value=[[0, 0], [1, 0], [0, 1]]
    )
    assert status_of("verify", write(box)) == 0
    assert "  [bold] from 0 to 1\n  a\\nb from 0 to 1\n" in capsys.readouterr().out


EXAMPLES = {
    "cartpole": "CartPole-v1",
    "lunarlander": "LunarLander-v3",
    "pendulum": "Pendulum-v1",
    "doorkey": "MiniGrid-DoorKey-5x5-v0",
}


def test_every_example_is_tried():
    assert {file.stem for file in SAFETY.glob("*.toml")} == set(EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_are_about_the_environments_they_name(name, write, capsys):
    if name == "doorkey":
        pytest.importorskip("minigrid")
    if name == "lunarlander":
        pytest.importorskip("Box2D")
    spec = resolve(EXAMPLES[name])
    features = spec.features
    tree = DecisionTree.from_complete(
        np.zeros(0, int),
        np.zeros(0),
        np.zeros((1, spec.actions.n_outputs)),
        actions=spec.actions,
        feature_names=features.names,
        feature_low=features.low,
        feature_high=features.high,
        groups=features.groups,
        integers=features.integers,
    )
    asked = read_properties(SAFETY / f"{name}.toml")
    assert status_of("verify", write(tree), "--properties", SAFETY / f"{name}.toml") in (0, 1)
    said = capsys.readouterr().out
    assert f" of {len(asked)} hold" in said
    assert "vacuously" not in said, "an example should be about something"


@pytest.mark.usefixtures("quick_compiles")
def test_a_run_is_held_to_the_file_in_its_folder(tmp_path, capsys):
    trained().save(tmp_path / "run")
    file = tmp_path / "run" / "safety.toml"
    file.write_text('[[property]]\nname = "fits"\nrule = "action is one of 0, 1"\n', encoding="utf-8")
    assert status_of("verify", tmp_path / "run") == 0
    assert capsys.readouterr().out.startswith("✓ fits\n")
    file.write_text('[[property]]\nname = "fits"\nrule = "pole angle is 0"\n', encoding="utf-8")
    assert "property 'fits': a claim is about actions" in refused(capsys, "verify", tmp_path / "run")
