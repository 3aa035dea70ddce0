"""An environment in a file of the user's, on the command line, and in the run that is made of it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sympol
from sympol.runs.metadata import RunError
from sympol.runs.trust import trusted_id

from .envs.tank import write_tank

TINY = (
    *("--total-timesteps", "256", "--num-envs", "4", "--num-steps", "16", "--depth", "2", "--num-evals", "1"),
    *("--num-eval-episodes", "1", "--eval-episodes", "1"),
)


def run_sympol(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; from sympol.cli.app import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-P", "-c", code, *words], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with plants/tank.py, and a run of it in runs/Tank-1."""
    folder = tmp_path_factory.mktemp("work")
    write_tank(folder / "plants")
    done = run_sympol(folder, "train", "plants/tank.py:Tank", "--env-kwargs", "inflow=0.2", *TINY)
    assert done.returncode == 0, done.stderr
    assert "training a tree of depth 2 on tank.py:Tank" in done.stderr
    assert "eval runs/Tank-1 --trust" in done.stdout
    return folder


def test_the_run_knows_its_file_in_every_folder(trained: Path, tmp_path: Path):
    run = str(trained / "runs" / "Tank-1")
    assert run_sympol(tmp_path, "show", run).returncode == 0
    refused = run_sympol(tmp_path, "eval", run)
    assert refused.returncode == 2
    assert f"say --trust or --env {trained}/plants/tank.py:Tank" in refused.stderr
    played = run_sympol(tmp_path, "eval", run, "--trust", "--episodes", "2", "--json")
    assert played.returncode == 0, played.stderr
    assert json.loads(played.stdout)["env"] == "tank.py:Tank"


def test_a_file_that_was_moved_is_asked_for(trained: Path, tmp_path: Path):
    shutil.copytree(trained, tmp_path / "copy")
    config = tmp_path / "copy/runs/Tank-1/config.toml"
    config.write_text(config.read_text().replace(str(trained), "/gone"))
    run = str(config.parent)
    with pytest.raises(
        RunError, match=r"needs the file tank.py .* \(/gone/plants/tank.py\); say where it is now: --env"
    ):
        trusted_id("tank.py:Tank", config.parent, trust=True, file="/gone/plants/tank.py")
    named = run_sympol(tmp_path, "eval", run, "--env", "copy/plants/tank.py:Tank", "--episodes", "1")
    assert named.returncode == 0, named.stderr
    resumed = run_sympol(tmp_path, "resume", run, "--env", "copy/plants/tank.py:Tank")
    assert resumed.returncode == 0, resumed.stderr


def test_a_run_in_python_is_loaded_with_its_environment_named(trained: Path, monkeypatch: pytest.MonkeyPatch):
    run = trained / "runs" / "Tank-1"
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(RunError, match="--trust"):
        sympol.load(run)
    agent = sympol.load(run, env=f"{trained}/plants/tank.py:Tank")
    assert agent.spec.env_kwargs == {"inflow": 0.2}
    assert sympol.load(run).spec.name == "tank.py:Tank"  # its code is imported now


@pytest.mark.parametrize("env", ["evil.py:Tank", "evil:Tank"])
def test_code_inside_a_run_is_not_run_even_where_the_run_is_trusted(trained: Path, tmp_path: Path, env: str):
    shutil.copytree(trained / "runs/Tank-1", tmp_path / "run")
    config, evil = tmp_path / "run/config.toml", tmp_path / "run/evil.py"
    evil.write_text("open('code was run', 'w').close()\n")
    lines = [line for line in config.read_text().splitlines() if not line.startswith("file = ")]
    text = "\n".join(lines).replace('"tank.py:Tank"', f'"{env}"')
    config.write_text(text.replace("[run]", f'[run]\nfile = "{evil}"'))
    for words in (
        ("eval", "."),
        ("eval", ".", "--trust"),
        ("show", "."),
        ("export", "."),
        ("resume", ".", "--trust"),
    ):
        done = run_sympol(tmp_path / "run", *words)
        assert done.returncode == (2 if words[0] in ("eval", "resume") else 0), done.stderr
        assert not (tmp_path / "run/code was run").exists(), words


def test_a_function_of_python_is_no_environment_of_a_folder(tmp_path: Path):
    for env in ("os:system", "shutil:rmtree", "subprocess:Popen", "sympol.cli.app:main"):
        with pytest.raises(RunError, match="--trust"):
            trusted_id(env, tmp_path)


def test_check_says_what_it_sees_and_what_would_be_trained(tmp_path: Path):
    write_tank(tmp_path)
    done = run_sympol(tmp_path, "check", "tank.py:Tank", "--seconds", "0.2", "--total-timesteps", "200k")
    assert done.returncode == 0, done.stderr
    lines = {line.split()[0]: line for line in done.stdout.splitlines()[:10]}
    assert [*lines] == [
        *(
            "environment",
            "observations",
            "actions",
            "time",
            "speed",
            "reward",
            "episodes",
            "recipe",
            "validation",
        )
    ]
    assert "3 features: level 0 to 10; one of pump = 0, pump = 1" in lines["observations"]
    assert "one of off, on" in lines["actions"]
    assert "200,000 steps" in lines["recipe"]
    assert "of 20 to 20 steps, 0 ended by themselves and" in lines["episodes"]
    assert "train tank.py:Tank --total-timesteps 200000" in done.stdout
    assert [file.name for file in tmp_path.iterdir() if file.name != "__pycache__"] == ["tank.py"]


def test_check_refuses_what_cannot_be_trained(tmp_path: Path):
    file = write_tank(tmp_path)
    file.write_text(file.read_text().replace("self.time >= 20", "False"))
    done = run_sympol(tmp_path, "check", "tank.py:Tank", "--seconds", "0", "--json")
    assert done.returncode == 1
    assert "no episode ended within 10,000 steps" in json.loads(done.stdout)["wrong"][0]
    file.write_text(file.read_text().replace("abs(self.level - 5)", "self.pipes"))
    broken = run_sympol(tmp_path, "check", "tank.py:Tank", "--seconds", "0")
    assert broken.returncode == 1
    assert "AttributeError: 'Tank' object has no attribute 'pipes'" in broken.stderr
    assert broken.stderr.startswith("error: ")


def test_a_simulator_of_two_functions_is_trained_by_its_file(tmp_path: Path):
    page = Path(__file__).parents[1] / "docs/guides/your-simulator.md"
    (tmp_path / "plant.py").write_text(
        page.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    )
    done = run_sympol(tmp_path, "train", "plant.py:tank", *TINY, "--max-rules", "2")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "runs/tank-1/policy.json").exists()
    assert run_sympol(tmp_path, "eval", "runs/tank-1", "--trust", "--episodes", "1").returncode == 0
