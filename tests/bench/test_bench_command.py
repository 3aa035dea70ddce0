"""``sympol bench`` as it is typed: methods and environments of one's own, what is said, bad input."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympol
from sympol.bench import methods
from sympol.bench.methods import agent_for, method_of, register_method
from sympol.bench.record import Cell
from sympol.bench.tables import TABLES
from sympol.bench.worker import take_turns
from sympol.runs.run import Run
from sympol.training import training_seconds

from ..tiny import COLUMNS, agent, quick_compiles, refused, status_of, trained
from . import own_methods as own_functions
from .bench import records, tiny_bench

__all__ = ["quick_compiles", "tiny_bench"]

HERE = "tests.bench.own_methods"
SMALL = ["--trainings", "2", "--episodes", "2", "--total-timesteps", "2048"]


@pytest.fixture(autouse=True)
def own_methods(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what a test registers."""
    monkeypatch.setattr(methods, "_REGISTERED", {})


def words(root: Path, *methods: str, environments: tuple[str, ...] = ("CartPole-v1",)) -> list[str]:
    return [
        "control-ppo",
        "--environments",
        *environments,
        "--methods",
        *methods,
        "--root",
        str(root),
        *SMALL,
    ]


def test_a_method_of_ones_own_stands_in_the_table(tmp_path, capsys):
    methods = [f"by-hand={HERE}:by_hand", f"leftwards={HERE}:leftwards"]
    assert status_of("bench", *words(tmp_path, *methods)) == 0
    said = capsys.readouterr()
    assert "by-hand" in said.out
    assert "0 of 2 cells are finished; 4 trainings or trees to run" in said.err
    found = records(tmp_path)
    assert found["by-hand"].nodes == (3, 3)
    assert np.mean(found["by-hand"].returns) > 100 > np.mean(found["leftwards"].returns)
    assert found["leftwards"].nodes is None
    told = tmp_path / "runs/bench/CartPole-v1/ppo-leftwards/seed-1/told.txt"
    assert told.read_text() == "CartPole-v1 1 2048"
    table = (tmp_path / "results/tables/control-ppo.md").read_text()
    assert "| by-hand | " in table
    assert "Acrobot-v1" in table  # the whole table, with what is not run
    assert "38 of its 40 cells are not run; to run them: sympol bench control-ppo --trainings 2" in said.err

    assert status_of("bench", *words(tmp_path, *methods)) == 0
    assert "2 of 2 cells are finished; 0 trainings or trees to run" in capsys.readouterr().err


def test_workers_and_one_process_give_the_same_records(tmp_path, capsys):
    methods = [f"by-hand={HERE}:by_hand", f"leftwards={HERE}:leftwards"]
    assert status_of("bench", *words(tmp_path / "one", *methods)) == 0
    assert status_of("bench", *words(tmp_path / "two", *methods), "--workers", "2") == 0
    one, two = records(tmp_path / "one"), records(tmp_path / "two")
    assert {name: record.returns for name, record in one.items()} == {
        name: record.returns for name, record in two.items()
    }


def test_an_environment_of_ones_own_stands_in_the_table(tmp_path, capsys):
    mine = "tests.runs.host_envs:HostCartPole-v0"
    assert status_of("bench", *words(tmp_path, f"by-hand={HERE}:by_hand", environments=(mine,))) == 0
    assert records(tmp_path)["by-hand"].environment == mine
    assert mine in (tmp_path / "results/tables/control-ppo.csv").read_text()


def test_what_fails_is_named_and_the_rest_is_kept(tmp_path, capsys):
    line = words(tmp_path, f"by-hand={HERE}:by_hand", f"broken={HERE}:fails_first")
    assert status_of("bench", *line) == 1
    said = capsys.readouterr().err
    assert "error: CartPole-v1 ppo-broken seed 1: RuntimeError: seed 1 is broken" in said
    assert {name: record.seeds for name, record in records(tmp_path).items()} == {
        "by-hand": (0, 1),
        "broken": (0,),
    }
    (tmp_path / "runs/bench/CartPole-v1/ppo-broken/repaired").touch()
    assert status_of("bench", *line) == 0
    assert "1 of 2 cells are finished; 1 trainings or trees to run" in capsys.readouterr().err
    assert records(tmp_path)["broken"].seeds == (0, 1)


def test_trees_of_a_teacher_that_failed_fail_with_it(tmp_path, capsys, monkeypatch):
    def fail(*_: Any) -> None:
        raise RuntimeError("no memory left")

    monkeypatch.setattr("sympol.bench.worker.train_agent", fail)
    assert status_of("bench", *words(tmp_path, "sa-dt-5")) == 1
    said = capsys.readouterr().err
    assert "CartPole-v1 ppo-mlp seed 0: RuntimeError: no memory left" in said
    assert "CartPole-v1 ppo-sa-dt-5 seed 1: the training of its teacher failed" in said


def test_list_says_what_there_is_to_do_and_does_nothing(tmp_path, capsys):
    assert status_of("bench", "viper-control", "--list", "--root", tmp_path) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = TABLES["viper-control"].cells()
    assert len(lines) == len(cells) == 8 * 5 - 4  # no VIPER for continuous actions
    assert all(line.endswith("5 to run     not run") for line in lines)
    assert not (tmp_path / "runs").exists()


def test_tables_are_written_without_running_anything(tmp_path, capsys):
    assert status_of("bench", "tree-size", "--render-only", "--root", tmp_path) == 0
    assert "20 of its 20 cells are not run" in capsys.readouterr().err
    assert (tmp_path / "results/tables/tree-size.tex").is_file()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["controll-ppo"], r"unknown table 'controll-ppo'; there are control-ppo, "),
        (
            ["control-ppo", "--methods", "tre"],
            r"unknown method 'tre'; there are tree, .*NAME=MODULE:FUNCTION",
        ),
        (["control-ppo", "--methods", "mine=nowhere:at_all"], r"'nowhere:at_all': No module named 'nowhere'"),
        (["control-ppo", "--methods", f"tree={HERE}:by_hand"], "tree is a method of the tables already"),
        (["control-ppo", "--methods", f"My Own={HERE}:by_hand"], "small letters"),
        (["control-ppo", "--environments", "CartPol-v1"], "unknown environment 'CartPol-v1': did you mean"),
        (["ablation", "--variants", "static-bach"], "unknown variant 'static-bach'; there are tree-critic, "),
        (["control-ppo", "--methods", "mlp", "--variants", "softsign"], "surrogate belongs to tree"),
        (["control-ppo", "--trainings", "0"], "--trainings must be from 1 to 1000, got 0"),
        (["control-ppo", "--episodes", "0"], "--episodes must be at least 1, got 0"),
        (["control-ppo", "--total-timesteps", "-5"], "--total-timesteps must be at least 1, got -5"),
        (["control-ppo", "--total-timesteps", "50"], "total_timesteps must cover one rollout"),
        (["control-ppo", "--imports", "no_such_module"], "cannot import 'no_such_module'"),
        (["control-ppo", "--workers", "0"], "--workers must be at least 1, got 0"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, line, said):
    assert re.search(said, refused(capsys, "bench", *line, "--root", tmp_path))
    assert not (tmp_path / "runs").exists()


def test_variants_are_of_methods_that_are_trained(tmp_path, capsys):
    line = words(tmp_path, f"by-hand={HERE}:by_hand")
    assert "which knows no variants" in refused(capsys, "bench", *line, "--variants", "static-batch")


def test_a_method_is_registered_by_its_function_too():
    register_method("leftwards", own_functions.leftwards)
    assert method_of("leftwards").label == "leftwards"
    with pytest.raises(ValueError, match="another process can import"):
        register_method("mine", lambda spec, **_: None)


def test_variants_change_what_they_say_and_nothing_else():
    plain = agent_for(Cell("CartPole-v1", "ppo", "tree-paper"), 0, 2048).config
    static = agent_for(Cell("CartPole-v1", "ppo", "tree-paper", "static-rollout"), 0, 2048).config
    assert dataclasses.replace(plain, dynamic_rollout=False) == static


def test_trainings_in_turns_are_what_they_are_alone(tmp_path):
    agents = [agent(seed=seed) for seed in (3, 4)]
    runs = [Run.create(tmp_path / str(a.seed), a.spec, a.config, a.seed) for a in agents]
    take_turns(agents, runs)
    for turned, run in zip(agents, runs, strict=True):
        assert turned.tree().to_json() == trained(seed=turned.seed).tree().to_json()
        elapsed = [row["time/time_elapsed"] for row in run.metrics.read()]
        assert len(elapsed) == 8
        assert elapsed == sorted(elapsed)
        assert training_seconds(run) == pytest.approx(elapsed[-1])
        assert sympol.load(run.path).tree().to_json() == turned.tree().to_json()


def test_seconds_of_a_training_that_was_interrupted_are_those_of_its_parts(tmp_path):
    a = agent()
    run = Run.create(tmp_path / "run", a.spec, a.config, 0)
    for step, elapsed in enumerate((1.0, 2.5, 0.5, 0.75)):
        run.metrics.append(
            {**dict.fromkeys(COLUMNS, 0.0), "time/total_timesteps": step, "time/time_elapsed": elapsed}
        )
    assert training_seconds(run) == 2.5 + 0.75


@pytest.mark.slow
def test_the_runtime_table_trains_in_turns_and_all_again_if_one_is_lacking(tmp_path, capsys):
    methods = ["--methods", "tree-paper", "mlp-paper"]
    cells = ["--environments", "CartPole-v1", *methods, "--variants", "runtime"]
    line = ["runtime", *cells, "--root", tmp_path, *SMALL]
    assert status_of("bench", *line) == 0
    said = capsys.readouterr()
    assert "Against: MLP, paper's settings." in " ".join(said.out.split())
    assert "CartPole-v1 ppo tree-paper mlp-paper in turns, seed 1" in said.err
    found = records(tmp_path)
    assert {*found} == {"tree-paper", "mlp-paper"}
    assert all(len(record.seconds or ()) == 2 for record in found.values())
    found["mlp-paper"].path(tmp_path).unlink()
    assert status_of("bench", *line, "--list") == 0
    assert capsys.readouterr().out.count("2 to run") == 2
