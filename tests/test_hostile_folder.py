"""A run's folder from a stranger: no command imports or runs what it names, unless the user says so."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sympol
from sympol.cli.app import main
from sympol.runs.metadata import RunError

MODULE = """
import pathlib
import gymnasium
pathlib.Path(__file__).with_name("code was run").touch()
gymnasium.register("Evil-v0", entry_point="gymnasium.envs.classic_control.cartpole:CartPoleEnv", max_episode_steps=20)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a tree, one of an MLP and one of a soft tree."""
    folder = tmp_path_factory.mktemp("runs")
    for policy in ("tree", "mlp", "sdt"):
        size = {"actor_hidden": (4,)} if policy == "mlp" else {"depth": 2}
        agent = sympol.PPO(
            policy,
            "CartPole-v1",
            total_timesteps=64,
            num_envs=2,
            num_steps=16,
            num_evals=1,
            backend="host",
            **size,
        )
        agent.learn(progress_bar=False).save(folder / policy)
    return folder


@pytest.fixture
def hostile(runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same folders, naming an environment of a module that lies in one of them."""
    shutil.copytree(runs, tmp_path / "runs")
    for run in (tmp_path / "runs").iterdir():
        config = run / "config.toml"
        config.write_text(config.read_text().replace('"CartPole-v1"', '"evil_module:Evil-v0"'))
    (tmp_path / "evil_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "evil_module", raising=False)
    return tmp_path


COMMANDS = [
    "show runs/sdt",
    "eval runs/tree",
    "eval runs/mlp",
    "watch runs/tree",
    "report runs/tree",
    "compare runs/tree runs/mlp",
    "resume runs/tree",
    "distill runs/mlp",
    "export runs/sdt --to svg",
    "verify runs/tree --robustness 1",
    "explain runs/tree --episode 1",
    "diff runs/tree runs/tree --episodes 1",
    "train CartPole-v1 --resume --run-dir runs/tree --depth 2",
    "pareto CartPole-v1 --teacher runs/mlp --out front --budget 100 --workers 1",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_runs_code_that_a_folder_names(command, hostile, capsys):
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert ended.value.code == 2, error
    assert error.startswith("error: ")
    assert not (hostile / "code was run").exists()
    assert "evil_module" not in sys.modules


@pytest.mark.parametrize(
    "command", ["show", "verify --property 'action is push left'", "export", "diff runs/tree"]
)
def test_what_needs_no_environment_works_without_it(command, hostile):
    name, *rest = shlex.split(command)
    assert main([name, "runs/tree", *rest]) in (0, 1)  # 1: a property that does not hold
    assert not (hostile / "code was run").exists()


def test_load_and_the_user_s_word(hostile):
    with pytest.raises(RunError, match=r"evil_module:Evil-v0.*--trust.*env='evil_module:Evil-v0'"):
        sympol.load("runs/mlp")
    assert not (hostile / "code was run").exists()
    assert sympol.load("runs/mlp", env="evil_module:Evil-v0").spec.max_episode_steps == 20
    assert (hostile / "code was run").exists()


@pytest.mark.parametrize("said", ["--trust", "--env evil_module:Evil-v0"])
def test_a_command_that_is_told_to_imports_the_module(said, hostile):
    words = f"eval runs/tree --episodes 2 {said}".split()
    program = f"import sys; from sympol.cli.app import main; sys.exit(main({words}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=hostile)
    assert done.returncode == 0, done.stderr
    assert "over 2 episodes" in done.stdout
    assert (hostile / "code was run").exists()


def test_an_id_that_would_import_what_its_arguments_name_is_refused_too(hostile):
    config = hostile / "runs/tree/config.toml"
    text = config.read_text().replace('"evil_module:Evil-v0"', '"GymV26Environment-v0"')
    config.write_text(
        text.replace("[config]", '[run.env_kwargs]\nenv_id = "evil_module:Evil-v0"\n\n[config]')
    )
    with pytest.raises(SystemExit):
        main(["eval", "runs/tree"])
    assert not (hostile / "code was run").exists()


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('wrappers = [{name = "RecordVideo", kwargs = {video_folder = "films"}}]', "wrapper must be one of"),
        ('wrappers = [{name = "make", kwargs = {}}]', "wrapper must be one of"),
        ('wrappers = ["TimeLimit"]', "wrappers must be tables of name and kwargs"),
        ('env_kwargs = {x = {"$type" = "os.system", value = "ls"}}', "not an argument of an environment"),
        ('env_kwargs = {x = {"$type" = "array", dtype = "O", shape = [1], data = [1]}}', "not an argument"),
    ],
)
def test_what_a_folder_says_of_its_environment_is_checked(lines, message, hostile, capsys):
    config = hostile / "runs/tree/config.toml"
    text = config.read_text().replace('"evil_module:Evil-v0"', '"CartPole-v1"')
    config.write_text(text.replace("[run]", f"[run]\n{lines}"))
    with pytest.raises(SystemExit) as ended:
        main(["eval", "runs/tree"])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err
    assert not (hostile / "films").exists()
