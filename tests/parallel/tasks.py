"""Tasks for the tests of workers: what they need is in their arguments, as for real ones."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import sympol.parallel as workers

HERE = __name__


def task(name: str, function: str, **arguments: Any) -> workers.Task:
    return workers.Task(name, f"{HERE}:{function}", arguments)


def square(x: int, seconds: float = 0.0) -> dict[str, Any]:
    time.sleep(seconds)
    return {"square": x * x, "both": (x, -x)}


def compute(seed: int) -> list[float]:
    """A gradient's sums over many samples: with one thread, two or eight, other last digits come out."""
    import jax

    one, two = jax.random.normal(jax.random.key(seed), (2, 4096, 64))
    mixed = jax.jit(lambda a, b: jax.numpy.tanh(a.T @ b / 64).sum(axis=0))(one, two)
    return mixed.tolist()


def train(seed: int) -> str:
    """A whole training; its tree, to the bit."""
    import sympol

    from ..tiny import TINY

    agent = sympol.PPO("tree", "CartPole-v1", seed=seed, **TINY)
    return str(agent.learn(progress_bar=False).tree().to_json())


def process() -> int:
    time.sleep(0.2)
    return os.getpid()


def die_once(marker: str, value: int) -> int:
    """Kill the own process the first time."""
    if not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return value


def die(marker: str) -> None:
    """Kill the own process each time, leaving a child behind."""
    child = subprocess.Popen(["sleep", "600"])
    with Path(marker).open("a") as file:
        file.write(f"{child.pid}\n")
    os.kill(os.getpid(), signal.SIGKILL)


def fork_and_die(marker: str) -> None:
    """Idem, by a fork, which has all our files open."""
    if (child := os.fork()) == 0:
        time.sleep(600)
    Path(marker).write_text(f"{child}\n")
    os.kill(os.getpid(), signal.SIGKILL)


def leave(code: int) -> None:
    print("last words")
    sys.stderr.flush()
    os._exit(code)


def fail(x: int) -> None:
    raise ArithmeticError(f"{x} is not\na number to my taste")


def leave_politely() -> None:
    raise SystemExit("a command ended")


def unspeakable() -> object:
    return object()


def noisy() -> str:
    print("noise on stdout")
    print("noise on stderr", file=sys.stderr)
    os.write(1, b"noise on 1")
    return sys.stdin.read()


def linger(folder: str, seconds: float) -> None:
    """Tell which processes are at work, and work."""
    child = subprocess.Popen(["sleep", "600"])
    (Path(folder) / f"{os.getpid()}-{child.pid}").touch()
    time.sleep(seconds)
    child.kill()
    child.wait()
