"""Ctrl-C in real processes, at many moments: one line, status 130, no traceback, nothing lost."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import sympol
from sympol.cli.learn import _ask_to_stop

from .tiny import TINY, flags, start

ROOT = Path(__file__).parents[1]
ENVS = """
import gymnasium, numpy as np, time
from gymnasium.spaces import Box, Discrete

class Plain(gymnasium.Env):
    observation_space, action_space = Box(-1, 1, (2,), np.float32), Discrete(2)
    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time = 0
        return np.zeros(2, np.float32), {}
    def step(self, action):
        self.time += 1
        return np.full(2, self.time / 10, np.float32), float(action), False, self.time >= 10, {}

class Swallows(Plain):
    '''Slow after the first save, so that the second is minutes away.'''
    steps = 0
    def step(self, action):
        Swallows.steps += 1
        while True:
            try:
                time.sleep(0.005 if Swallows.steps < 400 else 1)
                return super().step(action)
            except BaseException:
                pass

class Translates(Plain):
    def step(self, action):
        try:
            time.sleep(0.005)
            return super().step(action)
        except KeyboardInterrupt:
            raise RuntimeError("the simulator is gone") from None

class Waits(Plain):
    '''In machine code that lets other threads run and returns late, as XLA does.'''
    def step(self, action):
        import ctypes
        if self.time == 3:
            ctypes.CDLL(None).usleep(999_999)
        return super().step(action)

for made in (Swallows, Translates, Waits):
    gymnasium.register(f"{made.__name__}-v0", made)
"""


@pytest.fixture
def process(tmp_path: Path) -> Any:
    """Starts a command in ``tmp_path``, where the module ``interrupted_envs`` is."""
    (tmp_path / "interrupted_envs.py").write_text(ENVS)
    begun: list[subprocess.Popen[str]] = []

    def begin(*words: str | Path, optimized: bool = False) -> subprocess.Popen[str]:
        compile_anew = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "false", "JAX_COMPILATION_CACHE_DIR": ""}
        begun.append(start(*words, folder=tmp_path, **(compile_anew if optimized else {})))
        return begun[-1]

    yield begin
    for each in begun:
        each.kill()
        each.communicate()


def train(env: str, run: Path, **config: Any) -> list[str]:
    return ["train", env, *flags({**TINY, **config}), "--run-dir", str(run)]


def ended(process: subprocess.Popen[str], status: int = 130) -> list[str]:
    """What it said, once it has ended so."""
    began = time.monotonic()
    _, err = process.communicate(timeout=60)
    assert process.returncode == status, err
    assert time.monotonic() - began < 20, "too late, even on a busy machine"
    assert "Traceback" not in err
    assert "Exception ignored" not in err
    return err.splitlines()


def wait_until(true: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 120
    while not true():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["train", "eval", "show", "export"])
def test_while_modules_are_imported_it_says_one_line(process, command):
    words = [command, "CartPole-v1"] if command == "train" else [command, "nowhere"]
    for delay in (0.0, 0.3):
        begun = process(*words)
        wait_until(lambda pid=begun.pid: _catches_ctrl_c(pid), begun)
        time.sleep(delay)
        begun.send_signal(signal.SIGINT)
        said = begun.communicate(timeout=60)[1].splitlines()
        if not said or "no run in nowhere" not in said[0]:  # else it was faster than the signal
            assert (begun.returncode, said) == (130, ["interrupted"])


def _catches_ctrl_c(pid: int) -> bool:
    """Whether sympol's handler may be there: Python's own is as soon as the interpreter has started."""
    maps = Path(f"/proc/{pid}/maps")
    if not maps.exists():
        time.sleep(0.5)
        return True
    return "numpy" in maps.read_text()


@pytest.mark.slow
def test_while_the_program_is_compiled_it_ends_at_once_and_without_a_crash(process, tmp_path):
    for wait in (2.0, 4.0):
        run = tmp_path / f"run-{wait}"
        begun = process(*train("CartPole-v1", run, depth=7), optimized=True)
        wait_until(lambda run=run: (run / "config.toml").exists(), begun)
        time.sleep(wait)
        begun.send_signal(signal.SIGINT)
        assert ended(begun)[-1] == f"nothing is trained yet; resume with: sympol resume {run}"


@pytest.mark.slow
@pytest.mark.parametrize("env", ["Swallows-v0", "Translates-v0"])
def test_an_environment_cannot_swallow_it(process, tmp_path, env):
    run = tmp_path / "run"
    begun = process(*train(f"interrupted_envs:{env}", run))
    wait_until(lambda: any((run / "checkpoints").glob("*.json")), begun)
    begun.send_signal(signal.SIGINT)
    time.sleep(0.1)
    begun.send_signal(signal.SIGINT)
    said = ended(begun)
    newest = max(int(file.stem) for file in (run / "checkpoints").glob("*.json"))
    assert said[-1] == f"saved at step {newest:,}; resume with: sympol resume {run} --trust"


@pytest.mark.slow
def test_machine_code_that_does_not_return_cannot_keep_it(process, tmp_path):
    run = tmp_path / "run"
    begun = process(*train("interrupted_envs:Waits-v0", run, num_envs=64, total_timesteps=1024))
    wait_until(lambda: (run / "config.toml").exists(), begun)
    time.sleep(6)
    begun.send_signal(signal.SIGINT)
    assert ended(begun)[-1] == f"nothing is trained yet; resume with: sympol resume {run} --trust"


@pytest.mark.slow
def test_sigterm_waits_for_the_next_save_too(process, tmp_path):
    run = tmp_path / "run"
    begun = process(*train("interrupted_envs:Translates-v0", run))
    wait_until(lambda: any((run / "checkpoints").glob("*.json")), begun)
    for _ in range(2):  # as `timeout` sends it
        begun.send_signal(signal.SIGTERM)
        time.sleep(0.05)
    said = ended(begun, 143)
    assert "stopping at the next save; Ctrl-C again stops at once" in said
    newest = max(int(file.stem) for file in (run / "checkpoints").glob("*.json"))
    assert said[-1] == f"saved at step {newest:,}; resume with: sympol resume {run} --trust"


def test_python_minus_m_sympol_is_the_command():
    environment = {**os.environ, "PYTHONPATH": str(Path(sympol.__file__).parents[1])}
    command = [sys.executable, "-m", "sympol", "--version"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == f"sympol {sympol.__version__}\n"


def test_a_request_in_a_callback_whose_errors_are_ignored_is_remembered(recwarn):
    ignored: list[Any] = []
    sent: list[int] = []

    def collecting(phase: str, info: dict[str, int]) -> None:
        if not sent:
            sent.append(1)
            os.kill(os.getpid(), signal.SIGINT)

    before, sys.unraisablehook = sys.unraisablehook, ignored.append
    try:
        with _ask_to_stop(lambda: False) as asked:
            gc.callbacks.append(collecting)
            gc.collect()
            gc.callbacks.remove(collecting)
            assert asked.is_set()
    finally:
        sys.unraisablehook = before
    assert isinstance(ignored[0].exc_value, KeyboardInterrupt)


def test_in_python_it_is_a_keyboard_interrupt_and_the_agent_learns_on(tmp_path):
    """While it compiles, in this process: what has been compiled then is there for the next call."""
    learner = sympol.PPO("tree", "CartPole-v1", **{**TINY, "depth": 4, "critic_hidden": (9,)})

    def strike() -> None:
        while not any(thread.name == "compiling" for thread in threading.enumerate()):
            time.sleep(0.005)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=strike)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        learner.learn(progress_bar=False)
    thread.join()
    assert learner.num_timesteps == 0
    assert learner.learn(progress_bar=False).num_timesteps >= TINY["total_timesteps"]


@pytest.mark.slow
def test_a_script_that_is_interrupted_while_it_compiles_does_not_crash(tmp_path):
    script = """
import sympol, threading, os, signal, time
def strike():
    while not any(thread.name == "compiling" for thread in threading.enumerate()): time.sleep(0.005)
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=strike, daemon=True).start()
try:
    sympol.PPO("tree", "CartPole-v1", depth=5, total_timesteps=20000).learn(progress_bar=False)
except KeyboardInterrupt:
    raise SystemExit(7)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(sympol.__file__).parents[1]), "SYMPOL_CACHE_DIR": ""}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 7, done.stderr


def test_a_forked_process_has_a_ctrl_c_of_its_own():
    program = """
import os, signal, sys
from sympol.interrupts import interrupts
interrupts.listen()
with interrupts.heard(lambda number: True):
    child = os.fork()
    if child == 0:
        try:
            os.kill(os.getpid(), signal.SIGINT)
        except KeyboardInterrupt:
            os._exit(3)
        os._exit(4)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    print(status, interrupts.at_once)
"""
    environment = {**os.environ, "PYTHONPATH": str(Path(sympol.__file__).parents[1])}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "3 False\n"
