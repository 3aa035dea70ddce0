"""Running exported programs on this machine, with the compilers and interpreters that are installed.

A compiled program reads float32 rows from its standard input and writes actions to its standard output. Its arguments
are the number of rows and of rounds through them; it writes the seconds of each round to its standard error.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Float32
    from numpy.typing import DTypeLike

TIMEOUT = 600
"""Seconds that a compiler or a program may take."""
_T = TypeVar("_T")


class Run(NamedTuple):
    """The actions of a program, and the seconds of each round through all observations."""

    actions: np.ndarray
    seconds: tuple[float, ...]


def timed(rounds: int, function: Callable[[], _T]) -> tuple[_T, tuple[float, ...]]:
    """Call a function as often as there are rounds; return its last result and the seconds of each call."""
    seconds: list[float] = []
    while True:
        start = time.perf_counter()
        result = function()
        seconds.append(time.perf_counter() - start)
        if len(seconds) >= rounds:
            return result, tuple(seconds)


def compile_and_run(
    files: Mapping[str, str],
    build: Sequence[str],
    start: Sequence[str],
    x: Float32[np.ndarray, "batch features"],
    rounds: int,
    dtype: DTypeLike,
) -> Run:
    """Write files into a temporary folder, build a program there, and run it on observations.

    Args:
        files: Texts by file name.
        build: The command that compiles them; empty if nothing is compiled.
        start: The command that runs the program, without its arguments.
        x: The observations.
        rounds: How often the program goes through them.
        dtype: The type of the numbers that it writes.

    Returns:
        The actions, flat, and the seconds of each round.

    Raises:
        RuntimeError: If the program does not compile or run.
    """
    with tempfile.TemporaryDirectory(prefix="sympol-check-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        if build:
            call(build, folder)
        output, errors = call([*start, str(len(x)), str(rounds)], folder, x.tobytes())
    return Run(np.frombuffer(output, dtype), tuple(map(float, errors.split())))


def find_program(name: str, package: str) -> str:
    """Return the path of a program.

    Raises:
        FileNotFoundError: If it is not installed; the message names the distribution's package.
    """
    found = shutil.which(name)
    if found is None:
        raise FileNotFoundError(
            f"{name} is not on this machine; install the distribution's package {package}"
        )
    return found


def call(command: Sequence[str], folder: Path, stdin: bytes = b"") -> tuple[bytes, str]:
    """Run a program in a folder; return its standard output and its standard error.

    Raises:
        RuntimeError: If it fails, with what it wrote to its standard error, or takes longer than `TIMEOUT`.
    """
    try:
        done: Any = subprocess.run(
            command, cwd=folder, input=stdin, capture_output=True, timeout=TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise RuntimeError(f"{Path(command[0]).name} did not end in {TIMEOUT} seconds") from error
    errors = done.stderr.decode("utf-8", "replace")
    if done.returncode:
        raise RuntimeError(
            f"{Path(command[0]).name} failed with status {done.returncode}: {errors.strip()[:2000]}"
        )
    return done.stdout, errors
