"""`sympol --import MODULE`: what a module registers works on the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

MODULE = '''
from sympol.algorithms.ppo import PPO
from sympol.algorithms.registry import ALGORITHMS


class Mine(PPO):
    """Proximal policy optimization under another name."""


ALGORITHMS["mine"] = Mine
'''
TINY = (
    "--total-timesteps",
    "512",
    "--num-envs",
    "4",
    "--num-steps",
    "16",
    "--depth",
    "2",
    "--num-evals",
    "1",
)


def sympol(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; from sympol.cli.app import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *words], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(MODULE)
    return tmp_path


def test_an_algorithm_of_your_own_trains_and_its_run_is_read(folder: Path):
    run = ("--run-dir", "run", "--eval-episodes", "1", "--num-eval-episodes", "1")
    trained = sympol(folder, "--import", "mine", "train", "CartPole-v1", "--algorithm", "mine", *TINY, *run)
    assert trained.returncode == 0, trained.stderr
    assert sympol(folder, "--import", "mine", "show", "run").returncode == 0
    without = sympol(folder, "show", "run")
    assert without.returncode == 2
    assert "sympol --import MODULE" in without.stderr


def test_an_unknown_module_is_refused_in_one_line(folder: Path):
    done = sympol(folder, "--import", "nothing_here", "show", "run")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: --import nothing_here: there is no module nothing_here; is its folder on PYTHONPATH? A file is named "
        "with its ending: nothing_here.py"
    ]


@pytest.mark.parametrize("words", [("--import",), ("--import", "mine")])
def test_a_command_must_follow(folder: Path, words: tuple[str, ...]):
    done = sympol(folder, *words)
    assert done.returncode == 2
    assert "unknown command ''" in done.stderr
