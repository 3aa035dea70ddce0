"""``sympol tune`` as it is typed, and the preset it leaves: what ``sympol train --preset`` makes of it."""

from __future__ import annotations

import json
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import sympol
from sympol.algorithms.config import ConfigError
from sympol.algorithms.presets import preset
from sympol.cli.train import parse_train
from sympol.runs.run import Run
from sympol.tune import study as module
from sympol.tune.report import best_trials, save_preset
from sympol.tune.study import open_study, search_of

from .tiny import quick_compiles, refused, status_of
from .tune.postgres import free_port
from .tune.tuning import EVALS, SPACE, STEPS, Scripted, as_others_compute, tiny_preset

__all__ = ["as_others_compute", "quick_compiles"]


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One program for all trials, in a folder of their own."""
    monkeypatch.setattr(module, "space_of", lambda *_, **__: SPACE)
    monkeypatch.setattr(module, "fixed", lambda *_: {})
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Any:
    def use(*curves: Any) -> None:
        monkeypatch.setattr("sympol.tune.tune.agent_of", Scripted(*curves))

    return use


def words(trials: int = 2, *more: str) -> list[str]:
    tiny = tiny_preset(Path())
    return ["CartPole-v1", "--trials", str(trials), "--total-timesteps", str(STEPS), "--preset", tiny, *more]


def test_from_a_search_to_a_training_with_its_best(capsys):
    assert status_of("tune", *words(3, "--save-preset", "best.toml")) == 0
    said = capsys.readouterr()
    assert "CartPole-v1-ppo-tree: 3 completed, 0 pruned, 0 failed" in said.out
    assert "learning_rate_leaf_values" in said.out
    assert (
        "3 trials of a tree by PPO on CartPole-v1, 2,048 steps, seed 1000; study CartPole-v1-ppo-tree"
        in said.err
    )
    assert "trial 2: return" in said.err
    assert "the best is in best.toml; train with it: sympol train CartPole-v1 --preset best.toml" in said.err
    journal = Path("runs/tune/CartPole-v1-ppo-tree.journal")
    assert journal.is_file()
    assert Path("runs/tune/CartPole-v1-ppo-tree-history.svg").is_file()

    study = open_study(str(journal), "CartPole-v1-ppo-tree")
    best = best_trials(study)[0]
    config = search_of(study).config_of(best.params)
    train = ["CartPole-v1", "--preset", "best.toml", "--seed", "1000"]
    assert parse_train(train).config == config
    assert sympol.PPO("tree", "CartPole-v1", preset="best.toml").config == config
    assert status_of("train", *train, "--run-dir", "run", "--eval-episodes", "1") == 0
    assert Run.open(Path("run")).config == config
    assert json.loads(Path("run/summary.json").read_text())["validation_return"] == best.value


def test_the_preset_says_where_it_comes_from_and_leaves_others_alone(scripted):
    scripted([7.5] * EVALS)
    other = {"mlp": {"default": {"gamma": 0.5}}, "tree": {"paper": {"depth": 7}, "default": {"depth": 2}}}
    Path("mine.toml").write_text(tomli_w.dumps({"ppo": other}))
    assert status_of("tune", *words(2, "--save-preset", "mine.toml", "--seeds", "2")) == 0
    content = tomllib.loads(Path("mine.toml").read_text())
    assert content["ppo"]["mlp"] == other["mlp"]
    assert content["ppo"]["tree"]["paper"] == {"depth": 7}
    source = content["ppo"]["tree"]["default"]["source"]
    assert source.startswith("the best of 2 trials of `sympol tune CartPole-v1 --policy tree --algorithm ppo")
    assert source.endswith("(trial 0), seeds 1000, 1001, validation return 7.5")
    assert content["ppo"]["tree"]["default"]["max_grad_norm"] == float("inf")


def test_more_trials_are_added_and_none_is_run_twice(scripted, capsys):
    scripted([7.5] * EVALS)
    assert status_of("tune", *words(2)) == 0
    capsys.readouterr()
    assert status_of("tune", *words(3)) == 0
    said = capsys.readouterr()
    assert "trial 2: return 7.500" in said.err
    assert "trial 1:" not in said.err
    assert "3 completed" in said.out


def test_another_storage_and_another_study_have_plots_beside_them(scripted):
    scripted([7.5] * EVALS)
    assert status_of("tune", *words(1, "--storage", "there/all.journal", "--study", "deep/one")) == 0
    assert status_of("tune", *words(1, "--storage", "there/all.journal", "--study", "two")) == 0
    assert {path.name for path in Path("there").iterdir()} >= {"deep_one-history.svg", "two-history.svg"}


def test_if_all_trials_fail_it_says_why(scripted, capsys):
    scripted(sympol.envs.errors.EnvironmentFailure("the training came to NaN"))
    assert status_of("tune", *words(2, "--save-preset", "best.toml")) == 1
    said = capsys.readouterr().err
    assert "trial 0: failed: the training came to NaN" in said
    assert "error: no trial was completed; the last failed: the training came to NaN" in said
    assert not Path("best.toml").exists()
    with pytest.raises(ValueError, match=r"has no completed trial to make best.toml of; run more --trials"):
        save_preset(
            open_study("runs/tune/CartPole-v1-ppo-tree.journal", "CartPole-v1-ppo-tree"), Path("best.toml")
        )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["CartPol-v1"], "unknown environment 'CartPol-v1': did you mean"),
        (["CartPole-v1", "--policy", "forest"], "invalid choice 'forest'"),
        (["CartPole-v1", "--trials", "0"], "--trials must be at least 1, got 0"),
        (["CartPole-v1", "--seeds", "0"], "--seeds must be at least 1, got 0"),
        (["CartPole-v1", "--seeds", str(2**63)], f"--seeds must be at most 1,000, got {2**63}"),
        (["CartPole-v1", "--workers", "0"], "--workers must be at least 1, got 0"),
        (
            ["CartPole-v1", "--seed", "5"],
            "--seed must be at least 1000, got 5: smaller seeds are for trainings that",
        ),
        (["CartPole-v1", "--total-timesteps", "100"], "total_timesteps must cover one rollout"),
        (["CartPole-v1", "--preset", "papers"], "CartPole-v1 has no preset 'papers'"),
        (["CartPole-v1", "--preset", "no.toml"], "cannot read the preset no.toml: No such file"),
        (
            ["CartPole-v1", "--save-preset", "best"],
            "a preset's file must end in .toml, as in best.toml, got best",
        ),
        (["CartPole-v1", "--save-preset", "no/best.toml"], "is not a folder; make it"),
        (["CartPole-v1", "--storage", "sqlite:///s.db"], "got sqlite://…; for one machine a file does"),
        (["CartPole-v1", "--tirals", "3"], "unknown argument '--tirals'; did you mean --trials"),
    ],
)
def test_bad_input_is_one_line_before_anything_is_done(capsys, line, said):
    error = refused_after_a_plan(capsys, *line)
    assert said in error
    assert not Path("runs").exists()


def refused_after_a_plan(capsys: pytest.CaptureFixture[str], *line: str, status: int = 2) -> str:
    assert status_of("tune", *line) == status
    said = capsys.readouterr()
    assert said.out == ""
    *_, error = said.err.splitlines()
    assert error.startswith("error: ")
    return error


def test_an_unreachable_database_is_one_line_without_the_password(capsys):
    url = f"postgresql://u:s3cret@127.0.0.1:{free_port()}/d"
    assert status_of("tune", *words(1, "--storage", url)) == 1
    said = capsys.readouterr().err
    assert "error: PostgreSQL at host 127.0.0.1" in said
    assert "s3cret" not in said


def test_an_unreachable_scheduler_is_one_line(capsys, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("sympol.parallel.dask._TIMEOUT", 1)
    error = refused_after_a_plan(capsys, *words(1, "--scheduler", f"tcp://127.0.0.1:{free_port()}"), status=1)
    assert "no Dask scheduler answers at" in error


def test_without_the_extra(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    error = refused_after_a_plan(capsys, *words(1), status=1)
    assert "a search needs Optuna" in error
    assert "pip install 'sympol[tune]'" in error


def test_a_study_of_another_search_is_one_line(capsys, scripted):
    scripted([7.5] * EVALS)
    assert status_of("tune", *words(1)) == 0
    capsys.readouterr()
    line = words(1)
    line[line.index(str(STEPS))] = str(2 * STEPS)
    assert "created with total_timesteps 2048, not 4096" in refused_after_a_plan(capsys, *line)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("ppo = 3", r"has no section \[ppo.tree.default\]; it has none such"),
        (
            "[ppo.mlp.default]\ngamma = 0.9",
            r"no section \[ppo.tree.default\]; it has \[ppo.mlp.default\]; say --policy",
        ),
        ("[ppo.tree.paper]\ngamma = 0.9", r"it has \[ppo.tree.paper\]"),
        ("import os", "is not TOML"),
        ("[ppo.tree.default]\npolicy = 'mlp'", r"has another policy in its section"),
    ],
)
def test_a_file_that_holds_no_such_preset_is_refused(content, said, capsys):
    Path("best.toml").write_text(content)
    with pytest.raises(ConfigError, match=said):
        preset("CartPole-v1", "best.toml")
    refused(capsys, "train", "CartPole-v1", "--preset", "best.toml")
    assert not Path("runs").exists()


def test_a_preset_s_file_with_a_field_that_does_not_exist(capsys):
    Path("best.toml").write_text("[ppo.tree.default]\ngama = 0.9")
    assert "unknown config field 'gama'; did you mean gamma" in refused(
        capsys, "train", "CartPole-v1", "--preset", "./best.toml"
    )


@pytest.mark.parametrize("content", ["x = 1", "[ppo.tree]\ndefault = 3", "not toml", "[ppo]\ntree = 'x'"])
def test_a_file_of_something_else_is_not_written_to(content, capsys):
    Path("best.toml").write_text(content)
    error = refused_after_a_plan(capsys, *words(1, "--save-preset", "best.toml"))
    assert "best.toml is there and" in error
    assert Path("best.toml").read_text() == content
    assert not Path("runs").exists()
