"""``sympol distill`` and `sympol.distill_policy`: every kind of teacher, what is written and said, what is refused."""

from __future__ import annotations

import json
import pickle
import sys
import textwrap
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import sympol
from sympol.distill import Teacher
from sympol.runs.metadata import RunError
from sympol.runs.run import Run
from sympol.trees import DecisionTree

from .tiny import TINY, Chain, flags, quick_compiles, read_summary, refused, status_of

__all__ = ["quick_compiles"]

SDT = {key: value for key, value in TINY.items() if key != "critic_hidden"}
"""As in distill/test_discretize.py: one program for both."""
QUICK = ["--iterations", "2", "--episodes", "2", "--eval-episodes", "2"]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A finished run of a soft tree."""
    path = tmp_path_factory.mktemp("distill") / "sdt run"
    train = ["CartPole-v1", "--policy", "sdt", "--eval-episodes", "3", *flags(SDT)]
    assert status_of("train", *train, "--run-dir", path) == 0
    return path


@pytest.fixture
def module(tmp_path, monkeypatch) -> str:
    """A module of one's own in the working directory."""
    (tmp_path / "my_teachers.py").write_text(
        textwrap.dedent(
            """
            import math

            def lean(observation):
                return int(observation[2] + observation[3] > 0)

            def broken(observation):
                return math.nan

            class Model:
                def predict(self, observation, state=None, episode_start=None, deterministic=True):
                    return (observation[:, 2] + observation[:, 3] > 0).astype(int), None

            model = Model()

            class Sure:
                def __call__(self, observation):
                    return lean(observation)

                def action_probabilities(self, observation):
                    return [1 - 0.9 * lean(observation), 0.9 * lean(observation)]

            sure, number = Sure(), 3
            """
        )
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "my_teachers", raising=False)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return "my_teachers"


def test_a_soft_tree_s_run_has_its_picture_and_is_shown_and_exported(run, tmp_path, capsys):
    assert {file.name for file in run.iterdir() if file.is_file()} == {
        "config.toml", "metrics.csv", "summary.json", "tree.svg", "tree.txt",
    }  # fmt: skip
    assert sum(read_summary(run)["leaf_shares"]) == pytest.approx(1, abs=1e-4)
    capsys.readouterr()
    assert status_of("show", run) == 0
    text = (run / "tree.txt").read_text()
    assert capsys.readouterr().out.startswith(text)
    assert text.count(" ≤ ") == 7
    assert status_of("export", run, "--to", "text") == 0
    assert capsys.readouterr().out == text
    for kind in ("svg", "png"):
        assert status_of("export", run, "--to", kind, "--out", tmp_path / f"tree.{kind}") == 0
    assert (tmp_path / "tree.svg").read_bytes() == (run / "tree.svg").read_bytes()
    capsys.readouterr()
    assert "written as text, svg, pdf, png, not json; make a hard one of it" in refused(
        capsys, "export", run, "--to", "json"
    )


def test_a_soft_tree_becomes_hard_and_its_folder_is_as_a_run_s(run, capsys):
    assert status_of("distill", run, "--eval-episodes", "3") == 0
    said = capsys.readouterr().out
    path = run / "distilled" / "discretize-3"
    assert {file.name for file in path.iterdir()} == {
        "config.toml", "policy.json", "policy.py", "tree.txt", "tree.svg", "summary.json",
    }  # fmt: skip
    summary, tree = read_summary(path), Run.open(path).load_tree()
    assert said.startswith((path / "tree.txt").read_text())
    assert summary["distilled"] == {"method": "discretize", "depth": 3, "seed": 0, "teacher": str(run)}
    assert summary["nodes"] == tree.n_nodes
    assert summary["teacher_return_mean"] == read_summary(run)["return_mean"]  # the same episodes
    assert 0 <= summary["agreement"] <= 1
    assert "teacher  " in said
    assert f"sympol show '{path}'" in said
    expected = sympol.distill_policy(sympol.load(run))
    np.testing.assert_array_equal(expected.threshold, tree.threshold)
    for command in (["show"], ["eval", "--episodes", "2"], ["export"]):
        assert status_of(command[0], path, *command[1:]) == 0
    assert "test episodes on Gymnasium\n" in capsys.readouterr().out


def test_what_was_distilled_has_no_training_to_go_on_with(run, capsys):
    path = run / "distilled" / "discretize-3"
    if not path.exists():
        assert status_of("distill", run, "--eval-episodes", "2") == 0
    capsys.readouterr()
    for command in (["resume"], ["distill"]):
        assert "there is no training to load or resume; read it with sympol show" in refused(
            capsys, *command, path
        )
    with pytest.raises(RunError, match=r"distilled from .* by discretize"):
        sympol.load(path)
    assert "already holds a run; replace it with --overwrite, or choose another --out" in refused(
        capsys, "distill", run
    )
    assert status_of("distill", run, "--eval-episodes", "2", "--overwrite", "--json") == 0
    assert json.loads(capsys.readouterr().out) == read_summary(path)


@pytest.mark.parametrize(("method", "depth"), [("viper", 2), ("dagger", 1), ("sa-dt", 3)])
def test_other_methods_make_trees_of_a_run(run, tmp_path, method, depth):
    options = QUICK[2:] if method == "sa-dt" else QUICK
    out = ["--method", method, "--depth", str(depth), "--out", tmp_path / "a"]
    assert status_of("distill", run, *out, *options) == 0
    tree = Run.open(tmp_path / "a").load_tree()
    assert tree.depth <= depth
    assert tree.feature_names[0] == "cart position (m)"
    assert read_summary(tmp_path / "a")["distilled"]["depth"] == depth


def test_a_limit_of_nodes_in_place_of_a_depth(run, capsys):
    assert status_of("distill", run, "--method", "viper", "--max-nodes", "9", *QUICK) == 0
    path = run / "distilled" / "viper-9-nodes"
    assert Run.open(path).load_tree().n_nodes <= 9
    assert read_summary(path)["distilled"] == {
        "method": "viper", "max_nodes": 9, "seed": 0, "teacher": str(run),
    }  # fmt: skip
    capsys.readouterr()
    assert "max_nodes must be odd" in refused(capsys, "distill", run, "--method", "viper", "--max-nodes", "8")
    assert "--max-nodes belongs to sa-dt, viper, dagger; discretize has none" in refused(
        capsys, "distill", run, "--method", "discretize", "--max-nodes", "9"
    )


@pytest.mark.parametrize(("name", "method"), [("lean", "dagger"), ("model", "dagger"), ("sure", "viper")])
def test_a_function_is_a_teacher(module, name, method, capsys):
    options = ["--env", "CartPole-v1", "--depth", "2", *QUICK]
    assert status_of("distill", f"{module}:{name}", *options) == 0
    path = Path("runs") / f"CartPole-v1-{method}-2"
    assert read_summary(path)["distilled"]["method"] == method
    assert read_summary(path)["teacher_return_mean"] > 100
    assert status_of("eval", path, "--episodes", "2") == 0


def test_the_same_seed_gives_the_same_tree(module):
    for out in ("a", "b"):
        options = ["--env", "CartPole-v1", "--seed", "3", "--out", out, *QUICK]
        assert status_of("distill", f"{module}:lean", *options) == 0
    assert (Path("a") / "policy.json").read_text() == (Path("b") / "policy.json").read_text()


def test_continuous_actions_are_regressed_and_viper_names_the_method_that_fits(tmp_path, monkeypatch, capsys):
    (tmp_path / "swing.py").write_text("def swing(x):\n    return [2.0 if x[1] * x[2] > 0 else -2.0]\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    env = ["--env", "Pendulum-v1"]
    assert status_of("distill", "swing:swing", *env, *QUICK) == 0
    summary = read_summary(Path("runs/Pendulum-v1-dagger-5"))
    assert "agreement" not in summary
    assert summary["action_difference"] >= 0
    assert "from its own on average" in capsys.readouterr().out
    said = refused(capsys, "distill", "swing:swing", *env, "--method", "viper")
    assert "for continuous actions use the method dagger" in said
    assert not Path("runs/Pendulum-v1-viper-5").exists()


def test_teachers_that_do_not_fit(module, run, capsys):
    env = ["--env", "CartPole-v1"]
    said = {
        (f"{module}:broken", *env): "finite, got nan",
        (f"{module}:lean",): "--env must name the environment of my_teachers:lean",
        (f"{module}:gone", *env): "cannot import my_teachers:gone",
        ("no_such_module:f", *env): "cannot import no_such_module:f",
        (f"{module}:lean", *env, "--method", "discretize"): "needs an agent of policy 'sdt'",
        (f"{module}:lean", *env, "--method", "viper"): "viper needs a teacher with action values",
        (f"{module}:lean", *env, "--depth", "0"): "depth must be",
        (f"{module}:lean", "--env", "CartPole-v7"): "CartPole",
        (f"{module}:lean", "--env-kwargs", "a=1"): "--env-kwargs says how to make --env",
        ("nowhere",): "there is no teacher 'nowhere'; give a run's folder",
        (".",): "there is no run in .",
        (run, "--env", "Acrobot-v1"): "does not fit that of Acrobot-v1",
        (run, "--depth", "5", "--out", "other"): "depth must be the soft tree's own 3 or left out, got 5",
        (run, "--episodes", "5"): "--episodes belongs to sa-dt, viper, dagger; discretize has none",
        (
            run,
            "--method",
            "sa-dt",
            "--iterations",
            "5",
        ): "--iterations belongs to viper, dagger; sa-dt has none",
        (run, "--eval-episodes", "0"): "--eval-episodes must be at least 1",
        (run, "--out", f"{module}.py"): "is a file; choose another --out",
    }
    capsys.readouterr()
    for arguments, words in said.items():
        assert words in refused(capsys, "distill", *arguments), arguments
    assert not Path("runs").exists()


def test_an_unfinished_run_is_no_teacher(tmp_path, capsys):
    sympol.PPO("sdt", "CartPole-v1", **SDT).save(tmp_path / "run")
    said = refused(capsys, "distill", tmp_path / "run")
    assert "is not finished (0 of 2,048 steps); finish it: sympol resume" in said


def test_a_zip_is_read_only_if_it_is_trusted(tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "model.zip", "w") as archive:
        archive.writestr("data", json.dumps({"clip_range": {":serialized:": "x"}, "policy_class": {}}))
        archive.writestr("policy.pth", pickle.dumps("never read"))
    for name in ("model.zip", "model"):
        said = refused(capsys, "distill", tmp_path / name, "--env", "CartPole-v1")
        assert "--trust" in said
    assert "--env must name" in refused(capsys, "distill", tmp_path / "model.zip", "--trust")


def test_in_python_a_teacher_is_whatever_knows_what_to_do():
    quick: dict[str, Any] = {"num_iterations": 2, "episodes_per_iteration": 2, "num_validation_episodes": 2}

    def lean(observation: np.ndarray) -> int:
        return int(observation[2] + observation[3] > 0)

    tree = sympol.distill_policy(lean, env="CartPole-v1", depth=2, **quick)
    assert isinstance(tree, DecisionTree)
    same = sympol.distill_policy(Teacher.from_callable(lean, sympol.resolve("CartPole-v1")), depth=2, **quick)
    assert tree == same
    with pytest.raises(ValueError, match="env must be given"):
        sympol.distill_policy(lean)
    with pytest.raises(
        TypeError, match="a teacher is an agent, a Teacher, a model with predict, or a function"
    ):
        sympol.distill_policy(3, env="CartPole-v1")
    with pytest.raises(
        ValueError, match="method must be one of sa-dt, viper, dagger, discretize, got 'cart'"
    ):
        sympol.distill_policy(lean, "cart", env="CartPole-v1")
    with pytest.raises(ValueError, match="discretize has no options, got num_episodes"):
        sympol.distill_policy(sympol.PPO("sdt", "CartPole-v1", **SDT), "discretize", num_episodes=3)
    space = gymnasium.spaces.Box(-1, 1, (4,), np.float32)
    teacher = Teacher.from_callable(lean, sympol.resolve("CartPole-v1"))
    with pytest.raises(ValueError, match="action space"):
        sympol.distill_policy(teacher, env=Chain(space, gymnasium.spaces.Discrete(3)))
