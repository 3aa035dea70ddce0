"""A real process, killed at random moments, and one asked to stop."""

from __future__ import annotations

import random
import signal
import time
from pathlib import Path
from subprocess import Popen

import pytest

from ..tiny import TINY, TRAIN, csv_without_time, flags, quick_compiles, start, status_of

__all__ = ["quick_compiles"]

MANY = ["--eval-episodes", "3", *flags({**TINY, "num_evals": 32})]
"""A save every 64 steps."""


def train_words(env: str, run: Path) -> list[str]:
    return ["train", env, *MANY, "--run-dir", str(run)]


def resume_words(env: str, run: Path) -> list[str]:
    """An environment of a module's is the user's to name again, or to trust."""
    return ["resume", str(run), *(["--trust"] if ":" in env else [])]


def wait_for_saves(process: Popen[str], run: Path, already: int) -> None:
    """Until another checkpoint is there, or the process has ended."""
    deadline = time.monotonic() + 120
    while process.poll() is None and newest(run) <= already:
        assert time.monotonic() < deadline
        time.sleep(0.002)


def newest(run: Path) -> int:
    return max((int(file.stem) for file in (run / "checkpoints").glob("*.json")), default=0)


@pytest.fixture(
    scope="module",
    params=["CartPole-v1", "tests.runs.host_envs:HostCartPole-v0", "LunarLander-v3"],
    ids=["jax", "host", "native"],
)
def uninterrupted(request, tmp_path_factory) -> tuple[str, Path]:
    run = tmp_path_factory.mktemp("uninterrupted") / "run"
    assert status_of(*train_words(request.param, run)) == 0
    return request.param, run


def assert_same(run: Path, other: Path) -> None:
    for file in ("policy.json", "policy.py", "tree.txt", "tree.svg"):
        assert (run / file).read_bytes() == (other / file).read_bytes(), file
    assert csv_without_time(run) == csv_without_time(other)


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_in_the_same_tree(uninterrupted, tmp_path):
    env, whole = uninterrupted
    run, dice = tmp_path / "run", random.Random()
    root = Path(__file__).parents[2]
    for words in (train_words(env, run), resume_words(env, run)):
        already = newest(run)
        process = start(*words, folder=root)
        wait_for_saves(process, run, already)
        time.sleep(dice.uniform(0, 0.1))
        process.kill()
        process.communicate()
        assert newest(run) > already
    assert status_of(*resume_words(env, run)) == 0
    assert_same(run, whole)


@pytest.mark.slow
def test_interrupted_it_saves_says_how_to_go_on_and_does(uninterrupted, tmp_path):
    env, whole = uninterrupted
    run = tmp_path / "run"
    process = start(*train_words(env, run), folder=Path(__file__).parents[2])
    wait_for_saves(process, run, 0)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    if process.returncode == 0:  # it was faster than the signal
        pytest.skip("the training had ended already")
    assert process.returncode == 130, err
    assert out == ""
    assert "Traceback" not in err
    way_on = " ".join(["sympol", *resume_words(env, run)])
    assert err.splitlines()[-1] == f"saved at step {newest(run):,}; resume with: {way_on}"
    assert status_of(*resume_words(env, run)) == 0
    assert_same(run, whole)


def test_interrupted_twice_it_stops_at_once(tmp_path, monkeypatch, capsys):
    """Ctrl-C before anything is saved, in this process."""
    monkeypatch.setattr("sympol.agents.trainer_of", lambda *_: signal.raise_signal(signal.SIGINT))
    run = tmp_path / "run"
    assert status_of("train", *TRAIN, "--run-dir", run) == 130
    assert (
        capsys.readouterr().err.splitlines()[-1]
        == f"nothing is trained yet; resume with: sympol resume {run}"
    )
    monkeypatch.undo()
    assert status_of("resume", run) == 0
    assert (run / "summary.json").exists()
