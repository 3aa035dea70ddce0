"""The commands, mostly in this process: what they print, what they write, how they refuse."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import gymnasium
import numpy as np
import pytest

import sympol
from sympol.algorithms.config import Config, applies
from sympol.cli.app import COMMANDS
from sympol.cli.train import parse_train
from sympol.envs.entries import REGISTERED
from sympol.runs.metrics import TensorBoard
from sympol.runs.run import Run
from sympol.trees import DecisionTree

from .test_agents import Troubled
from .tiny import (
    COLUMNS,
    TINY,
    TRAIN,
    agent,
    csv_without_time,
    quick_compiles,
    read_summary,
    refused,
    status_of,
)

__all__ = ["quick_compiles"]

SUMMARY_KEYS = {
    "env", "seed", "timesteps", "nodes", "nodes_unpruned", "leaves", "depth", "validation_return",
    "best_timestep", "return_mean", "return_std", "sampled_return_mean", "sampled_return_std", "episodes",
    "eval_seed", "preset", "run_dir", "versions", "wall_seconds", "compile_seconds", "training_seconds",
    "steps_per_second",
}  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A finished run."""
    path = tmp_path_factory.mktemp("cli") / "run"
    assert status_of("train", *TRAIN, "--run-dir", path) == 0
    return path


def test_train_prints_one_line_of_json_and_the_same_is_in_the_folder(tmp_path, capsys):
    assert status_of("train", *TRAIN, "--run-dir", tmp_path / "run", "--json") == 0
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    assert json.loads(said) == read_summary(tmp_path / "run")
    assert set(json.loads(said)) == SUMMARY_KEYS


def test_train_shows_the_tree_its_return_and_what_to_do_next(tmp_path, capsys):
    path = tmp_path / "my run"
    assert status_of("train", *TRAIN, "--run-dir", path) == 0
    said = capsys.readouterr().out
    summary = read_summary(path)
    assert said.startswith((path / "tree.txt").read_text())
    n = 1 if abs(summary["return_mean"]) >= 10 else 3
    assert (
        f"return   {summary['return_mean']:,.{n}f} ± {summary['return_std']:,.{n}f} over 3 test episodes"
        in said
    )
    assert f"size     {summary['nodes']} nodes" in said
    for command in ("show", "eval", "export"):
        assert f"sympol {command} '{path}'" in said


def test_a_run_s_folder(run):
    files = {str(file.relative_to(run)) for file in run.rglob("*") if file.is_file()}
    checkpoints = {file for file in files if file.startswith("checkpoints/")}
    assert files - checkpoints == {
        "config.toml", "metrics.csv", "policy.json", "policy.py", "tree.txt", "tree.svg", "summary.json",
    }  # fmt: skip
    assert len(checkpoints) == 4
    tree = DecisionTree.from_json((run / "policy.json").read_text())
    assert tree.to_text() + "\n" == (run / "tree.txt").read_text()
    assert tree.to_python() == (run / "policy.py").read_text()
    assert tree.n_node_samples is not None
    summary = read_summary(run)
    assert (summary["nodes"], summary["nodes_unpruned"]) == (tree.n_nodes, 2 ** (TINY["depth"] + 1) - 1)
    rows = (run / "metrics.csv").read_text().splitlines()
    assert rows[0] == ",".join(COLUMNS)
    assert [int(row.split(",")[0]) for row in rows[1:]] == sorted(
        {int(row.split(",")[0]) for row in rows[1:]}
    )
    assert len(rows) == 1 + TINY["num_evals"]
    config = Run.open(run)
    assert config.config == agent().config
    assert config.metadata["eval_episodes"] == 3


def test_the_command_and_the_verbs_train_the_same_tree(run):
    one = agent().learn(progress_bar=False)
    tree = DecisionTree.from_json((run / "policy.json").read_text())
    assert dataclasses.replace(tree, n_node_samples=None) == one.tree()
    assert sympol.load(run).tree(prune=False) == one.tree(prune=False)


def test_two_runs_get_two_folders(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert status_of("train", *TRAIN, "--json") == 0
    said = [json.loads(line)["run_dir"] for line in capsys.readouterr().out.splitlines()]
    assert said == ["runs/CartPole-v1-1", "runs/CartPole-v1-2"]
    assert csv_without_time(Path(said[0])) == csv_without_time(Path(said[1]))


def test_eval_repeats_itself(run, capsys):
    said = []
    for seed in ("7", "7", "8"):
        assert status_of("eval", run, "--episodes", "5", "--seed", seed, "--json") == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1] != said[2]
    result = json.loads(said[0])
    assert set(result) == {"env", "return_mean", "return_std", "episodes", "eval_seed"}
    tree = DecisionTree.from_json((run / "policy.json").read_text())
    assert sympol.evaluate_policy(tree, "CartPole-v1", 5, seed=7) == (
        result["return_mean"],
        result["return_std"],
    )
    assert status_of("eval", run, "--episodes", "5") == 0
    n = 1 if abs(result["return_mean"]) >= 10 else 3
    words = (
        f"CartPole-v1: return {result['return_mean']:,.{n}f} ± {result['return_std']:,.{n}f} over 5 episodes"
    )
    assert capsys.readouterr().out == f"{words} (seed 7)\n"


def test_show(run, capsys):
    assert status_of("show", run) == 0
    said = capsys.readouterr().out
    assert said.startswith((run / "tree.txt").read_text())
    assert "\nreturn   " in said
    assert "\nsize     " in said


def test_a_terminal_without_unicode_still_shows_the_tree(run):
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "sympol", "show", str(run)]
    done = subprocess.run(command, check=True, capture_output=True, env=environment)
    assert b" <= " in done.stdout
    assert b"\\u" not in done.stdout
    assert done.stderr == b""


@pytest.mark.parametrize("kind", ["python", "json", "text"])
def test_export_of_text(run, tmp_path, kind, capsys):
    file = run / {"python": "policy.py", "json": "policy.json", "text": "tree.txt"}[kind]
    assert status_of("export", run, "--to", kind) == 0
    assert capsys.readouterr().out.rstrip("\n") == file.read_text().rstrip("\n")
    assert status_of("export", run, "--to", kind, "--out", tmp_path / "out") == 0
    assert (tmp_path / "out").read_text().rstrip("\n") == file.read_text().rstrip("\n")
    assert capsys.readouterr().err == f"written to {tmp_path / 'out'}\n"


@pytest.mark.parametrize(("kind", "head"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_export_of_pictures(run, tmp_path, kind, head, capsys):
    assert status_of("export", run, "--to", kind, "--out", tmp_path / f"tree.{kind}") == 0
    assert (tmp_path / f"tree.{kind}").read_bytes().startswith(head)
    assert capsys.readouterr().out == ""


def test_an_exported_program_runs_alone_and_acts_as_the_tree(run, tmp_path):
    program = tmp_path / "policy.py"
    program.write_bytes((run / "policy.py").read_bytes())
    tree = DecisionTree.from_json((run / "policy.json").read_text())
    x = np.random.default_rng(0).normal(size=(200, 4)).astype(np.float32)
    code = f"import sys; sys.path.append({str(tmp_path)!r}); import policy\n"
    code += f"print([policy.act(r) for r in {x.tolist()}])"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], check=True, capture_output=True, text=True
    )
    assert json.loads(done.stdout) == tree.predict(x).tolist()
    done = subprocess.run(
        [sys.executable, "-I", str(program), *map(str, x[0].tolist())],
        check=True,
        capture_output=True,
        text=True,
    )
    assert int(done.stdout) == tree.predict(x[0])


@pytest.mark.parametrize("command", COMMANDS)
def test_help(command, capsys):
    assert status_of(command, "--help") == 0
    said = capsys.readouterr().out
    assert f"usage: sympol {command}" in said
    if command == "train":
        for field in dataclasses.fields(Config):
            assert f"--{field.name}".replace("_", "-") in said
        assert "(default: 0.02)" in said  # of the recipe for environments without a preset


def test_help_shows_the_environment_s_own_preset(capsys):
    from sympol.algorithms.presets import preset

    for words in (["CartPole-v1", "--help"], ["--seed", "3", "CartPole-v1", "--help"]):
        assert status_of("train", *words) == 0
        said = " ".join(capsys.readouterr().out.replace("│", " ").split())
        for value in preset("CartPole-v1").values():
            if type(value) in (int, float):
                assert f"(default: {value})" in said


@pytest.mark.parametrize(
    ("word", "number"), [("4e3", 4000), ("4000.0", 4000), ("4_000", 4000), ("4.5e3", 4500)]
)
def test_whole_numbers_may_be_written_as_floats(word, number):
    given = parse_train(
        ["CartPole-v1", "--total-timesteps", word, "--seed", "1e0", "--critic-hidden", "8e0", "4"]
    )
    assert given.config.total_timesteps == number
    assert type(given.config.total_timesteps) is int
    assert (given.seed, given.config.critic_hidden) == (1, (8, 4))


@pytest.mark.parametrize("word", ["4.5", "1e", "inf", "nan", "200q", "1e400", ""])
def test_what_is_no_whole_number_is_said(word):
    with pytest.raises(ValueError, match=rf"--total-timesteps.*must be a whole number.*, got '{word}'"):
        parse_train(["CartPole-v1", "--total-timesteps", word])


def test_what_fits_only_with_its_preset_is_taken():
    """450 steps are less than one rollout by default, and a whole one of the paper's seven environments."""
    given = parse_train(["CartPole-v1", "--total-timesteps", "450", "--preset", "paper"])
    assert given.config.total_timesteps == 450
    assert given.config.num_envs == 7


@pytest.mark.parametrize(("algorithm", "policy"), [("ppo", "tree"), ("a2c", "sdt"), ("ppo", "mlp")])
def test_every_field_is_a_flag(tmp_path, monkeypatch, algorithm, policy):
    """Each is set to something new; the last check stops the command before it trains."""
    given: dict[str, object] = {"surrogate": "softsign", "critic": policy, "depth": 4, "growth": 16}
    given |= {"num_envs": 6, "num_devices": 3, "threshold_init": "visited", "grow_splits": False}
    given["method"] = "direct"  # as the other one needs splits that grow
    given |= {"critic_hidden": (7, 9), "actor_hidden": (5, 3), "algorithm": algorithm, "policy": policy}
    new, words = {}, []
    for field in dataclasses.fields(Config):
        if not applies(field.name, algorithm, policy):
            new[field.name] = field.default
            continue
        value = given.get(field.name)
        if value is None:
            old = field.default
            value = (not old) if isinstance(old, bool) else 0.5 if isinstance(old, float) else old + 1
        new[field.name] = value
        flag = field.name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{flag}" if value else f"--no-{flag}")
        else:
            words += [f"--{flag}", *map(str, value if isinstance(value, tuple) else (value,))]
    seen = []
    monkeypatch.setattr("sympol.cli.learn.learn", lambda agent, run, *_, **__: seen.append(agent.config) or 0)
    assert status_of("train", "CartPole-v1", *words, "--run-dir", tmp_path / "run") == 0
    assert dataclasses.asdict(seen[0]) == new
    assert Run.open(tmp_path / "run").config == seen[0]


def test_the_preset_is_where_flags_fall_back_to(tmp_path, monkeypatch):
    from sympol.algorithms.presets import preset

    seen = []
    monkeypatch.setattr(
        "sympol.cli.learn.learn", lambda agent, run, *_, **__: seen.append((agent.config, run)) or 0
    )
    for i, words in enumerate(
        (["CartPole-v1", "--preset", "paper"], ["--preset=paper", "--seed", "3", "CartPole-v1"])
    ):
        assert status_of("train", *words, "--gamma", "0.5", "--run-dir", tmp_path / str(i)) == 0
    expected = Config.from_dict({**preset("CartPole-v1", "paper"), "gamma": 0.5})
    assert [config for config, _ in seen] == [expected, expected]
    assert seen[0][1].metadata["preset"] == "paper"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["CartPoel-v1"], "unknown environment 'CartPoel-v1': did you mean 'CartPole-v1'"),
        (["Zork-v0"], "nothing known has a similar name"),
        ([], "name an environment, as in: sympol train CartPole-v1"),
        (["CartPole-v1", "--depth", "0"], "depth must be between 1 and 14, got 0"),
        (
            ["CartPole-v1", "--depth", "15"],
            "depth must be between 1 and 14, got 15; a tree of depth 15 has 2^15",
        ),
        (["CartPole-v1", "--depth", "deep"], "--depth"),
        (["CartPole-v1", "--total-timesteps", "100"], "total_timesteps must cover one rollout"),
        (["CartPole-v1", "--gamma", "nan"], "gamma must be a number, got nan"),
        (["CartPole-v1", "--gamma", "inf"], "gamma must be between 0 and 1, got inf"),
        (["CartPole-v1", "--learning-rate-critic", "-inf"], "learning_rate_critic must be between 0 and 10"),
        (["CartPole-v1", "--critic-hidden", "0"], "critic_hidden must hold positive widths"),
        (
            ["CartPole-v1", "--critic-hidden", "8193"],
            "critic_hidden must hold at most 8 widths of at most 8,192",
        ),
        (["CartPole-v1", "--critic-hidden", *"111111111"], "critic_hidden must hold at most 8 widths"),
        (["CartPole-v1", "--surrogate", "step"], "invalid choice 'step' for argument '--surrogate'"),
        (["CartPole-v1", "--detph", "3"], "unknown argument '--detph'; did you mean --depth?"),
        (["CartPole-v1", "--depth"], "--depth"),
        (["CartPole-v1", "Pendulum-v1"], "unknown argument 'Pendulum-v1'"),
        (["CartPole-v1", "--seed", "-1"], "seed must be a whole number from 0"),
        (["CartPole-v1", "--preset", "nope"], "CartPole-v1 has no preset 'nope' for ppo with tree; it has "),
        (["CartPole-v1", "--backend", "gpu"], "invalid choice 'gpu'"),
        (["CartPole-v1", "--eval-episodes", "0"], "--eval-episodes must be at least 1, got 0"),
        (["Blackjack-v1", "--backend", "jax"], "Blackjack-v1 is not written in JAX"),
        (["Text-v0"], "unsupported observation space Text"),
        (["Binary-v0"], "unsupported action space MultiBinary"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_folder(words, message, tmp_path, monkeypatch, capsys):
    from gymnasium.spaces import Box, Discrete, MultiBinary, Text

    from .tiny import Chain

    monkeypatch.setitem(gymnasium.registry, "Text-v0", _spec("Text-v0", lambda: Chain(Text(3), Discrete(2))))
    monkeypatch.setitem(
        gymnasium.registry, "Binary-v0", _spec("Binary-v0", lambda: Chain(Box(0, 1), MultiBinary(2)))
    )
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, "train", *words)
    assert message in refused(capsys, "train", *words, "--run-dir", "here")
    assert list(tmp_path.iterdir()) == []


def _spec(name: str, make) -> gymnasium.envs.registration.EnvSpec:
    return gymnasium.envs.registration.EnvSpec(name, entry_point=make)


@pytest.mark.parametrize("command", ["show", "eval", "export", "resume"])
def test_a_run_that_is_not_there(command, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    for where in ("nowhere", ".", "file"):
        assert "it has no config.toml" in refused(capsys, command, tmp_path / where)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["eval", "--episodes", "0"], "n_eval_episodes must be at least 1, got 0"),
        (["eval", "--seed", "-3"], "seed must not be negative, got -3"),
        (["export", "--to", "cobol"], "unknown format 'cobol'; there are python, c, "),
        (["export", "--out", "/proc/no/such.py"], "choose another --out"),
        (["export", "--to", "svg", "--out", "/proc/no/such.svg"], "choose another --out"),
        (["show", "--json"], "unknown argument '--json'"),
    ],
)
def test_bad_input_to_the_readers(run, words, message, capsys):
    assert message in refused(capsys, words[0], run, *words[1:])


def test_the_shell_around_the_commands(capsys):
    assert status_of() == status_of("--help") == 0
    assert capsys.readouterr().out.count("sympol train CartPole-v1") == 2
    assert status_of("--version") == 0
    assert capsys.readouterr().out == f"sympol {sympol.__version__}\n"
    assert "did you mean train?" in refused(capsys, "tarin")
    assert "there are train, check, show, eval, watch, export" in refused(capsys, "cook")


def test_tensorboard(tmp_path, capsys, monkeypatch):
    assert status_of("train", *TRAIN, "--run-dir", tmp_path / "run", "--tensorboard") == 0
    (events,) = (tmp_path / "run" / "tensorboard").iterdir()
    assert b"rollout/ep_rew_mean" in events.read_bytes()
    capsys.readouterr()
    monkeypatch.setitem(sys.modules, "tensorboardX", None)
    line = refused(capsys, "train", *TRAIN, "--run-dir", tmp_path / "no", "--tensorboard", status=1)
    assert "pip install 'sympol[tensorboard]'" in line
    assert not (tmp_path / "no").exists()
    with pytest.raises(ImportError):
        TensorBoard(tmp_path)


def test_an_environment_that_needs_more_says_what(tmp_path, capsys, monkeypatch):
    def make():
        raise gymnasium.error.DependencyNotInstalled("Box2D is not installed")

    monkeypatch.setitem(gymnasium.registry, "Needy-v0", _spec("Needy-v0", make))
    assert "Box2D is not installed" in refused(
        capsys, "train", "Needy-v0", "--run-dir", tmp_path / "x", status=1
    )
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("trouble", ["raises", "nan observation"])
def test_an_environment_that_fails_in_the_middle(trouble, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(gymnasium.registry, "Troubled-v0", _spec("Troubled-v0", Troubled))
    words = ["Troubled-v0", *TRAIN[1:]]
    monkeypatch.setattr(Troubled, "trouble", trouble)
    assert status_of("train", *words, "--run-dir", tmp_path / "run") == 1
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if line.startswith(("error", "saved"))]
    assert said.out == ""
    assert "Traceback" not in said.err
    assert lines[0].startswith("error: at training step ")
    assert lines[1].startswith("saved at step ")
    assert lines[1].endswith(f"; resume with: sympol resume {tmp_path / 'run'}")
    monkeypatch.setattr(Troubled, "trouble", None)
    assert status_of("resume", tmp_path / "run", "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["timesteps"] >= TINY["total_timesteps"]
    assert summary == read_summary(tmp_path / "run")


def test_an_environment_that_fails_in_the_test_episodes(tmp_path, capsys, monkeypatch):
    def trouble(*_, **__):
        raise ZeroDivisionError("no track")

    with monkeypatch.context() as patch:
        patch.setattr("sympol.cli.learn.play", trouble)
        assert status_of("train", *TRAIN, "--run-dir", tmp_path / "run") == 1
    said = capsys.readouterr().err
    assert "error: in the test episodes, after training: ZeroDivisionError: no track" in said
    assert status_of("resume", tmp_path / "run") == 0
    assert read_summary(tmp_path / "run")["timesteps"] == 2048


def test_continuous_actions(tmp_path, capsys):
    words = ["Pendulum-v1", *TRAIN[1:]]
    run = tmp_path / "run"
    assert status_of("train", *words, "--run-dir", run, "--json") == 0
    summary = json.loads(capsys.readouterr().out)
    tree = DecisionTree.from_json((run / "policy.json").read_text())
    assert tree.actions.std is not None
    assert -2000 < summary["return_mean"] < 0
    assert status_of("export", run) == 0
    assert "torque" in capsys.readouterr().out
    assert status_of("resume", run) == 0
    assert read_summary(run)["return_mean"] == summary["return_mean"]


@patch.dict(REGISTERED)
def test_an_environment_that_is_only_in_jax(tmp_path, capsys):
    from .envs.probes import MultiDiscreteMatch

    sympol.register(
        "Signs-v0", MultiDiscreteMatch(), feature_names=("[1]", "[/]"), action_names=("one", "two")
    )
    run = tmp_path / "run"
    assert status_of("train", "Signs-v0", *TRAIN[1:], "--run-dir", run, "--json") == 0
    assert set(json.loads(capsys.readouterr().out)) == SUMMARY_KEYS
    assert status_of("show", run) == 0
    assert "one: " in capsys.readouterr().out
    assert status_of("eval", run, "--episodes", 3) == 0
    capsys.readouterr()
    assert "does not draw itself as pictures" in refused(capsys, "watch", run)
    assert status_of("resume", run) == 0


HOSTILE = (
    'quote " and \' and """',
    '"; import os; os.system("touch pwned") #',
    "</svg><script>alert(1)</script>",
    "[red]$\\frac$[/] :smile: \n\u202e é {x}",
)


@patch.dict(REGISTERED)
def test_a_name_stays_a_name_everywhere(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    from sympol.envs.classic.cartpole import CartPole

    actions = ("[bold]go[/]", "');import os#")
    sympol.register("CartPole-v1", CartPole(), feature_names=HOSTILE, action_names=actions)
    path = tmp_path / "[red]run[/] :smile:"
    assert status_of("train", *TRAIN, "--run-dir", path) == 0
    said = capsys.readouterr()
    text = (path / "tree.txt").read_text()
    assert said.out.startswith(text)
    assert "run: " + str(path) in said.err
    assert status_of("show", path) == 0
    assert capsys.readouterr().out.startswith(text)

    tree = DecisionTree.from_json((path / "policy.json").read_text())
    assert tree.feature_names == HOSTILE
    assert tree.actions.names == actions
    assert Run.open(path).metadata["feature_names"] == list(HOSTILE)
    for feature in {f for f in tree.feature if f >= 0}:
        printed = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode() for c in HOSTILE[feature]
        )
        assert printed in text
    svg = (path / "tree.svg").read_text()
    assert "<script" not in svg
    assert svg.count("</svg>") == 1
    done = subprocess.run(
        [sys.executable, "-I", path / "policy.py", "0", "0", "0", "0"], check=True, capture_output=True
    )
    assert int(done.stdout) == tree.predict([0, 0, 0, 0])
    assert not (tmp_path / "pwned").exists()
    assert status_of("eval", path, "--episodes", "1") == 0
    assert sympol.load(path).tree().feature_names == HOSTILE
