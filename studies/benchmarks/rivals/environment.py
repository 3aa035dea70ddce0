"""A virtual environment for each rival, built from exact pins: theirs would hold back ours."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from ..timing import ROOT

FOLDER = Path(__file__).resolve().parent
NAMES = tuple(sorted(file.stem for file in FOLDER.glob("*.txt")))
_COMPLETE = "complete"


def interpreter(name: str) -> Path:
    """Return the Python of a rival's environment, which is built first if it is missing.

    Args:
        name: One of `NAMES`; the pins are in ``NAME.txt`` beside this file.

    Returns:
        The path of the interpreter.

    Raises:
        ValueError: There is no such rival.
        subprocess.CalledProcessError: The packages cannot be installed; pip prints why.
    """
    if name not in NAMES:
        raise ValueError(f"a rival must be one of {', '.join(NAMES)}, got {name!r}")
    pins = FOLDER / f"{name}.txt"
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    digest = hashlib.sha256(version.encode() + pins.read_bytes()).hexdigest()[:12]
    folder = _cache() / f"{name}-{digest}"
    python = folder / "bin" / "python"
    if not (folder / _COMPLETE).exists():
        print(f"building an environment with {name} in {folder}; this takes some minutes", file=sys.stderr)
        shutil.rmtree(folder, ignore_errors=True)  # an earlier build was interrupted
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        install = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*install, "--requirement", str(pins)], check=True, stdout=sys.stderr)
        (folder / _COMPLETE).touch()
    return python


def last_line(name: str, *command: object, **variables: str) -> str:
    """Run a script with a rival's interpreter and return the last line that it prints.

    The script can import sympol as it is in this checkout.

    Args:
        name: The rival.
        *command: The script and its arguments.
        **variables: Environment variables, besides those of this process.

    Raises:
        RuntimeError: The script failed; the message ends with what it wrote to its error stream.
    """
    words = [str(interpreter(name)), *map(str, command)]
    env = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **variables}
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=env)
    if done.returncode:
        raise RuntimeError(f"{name} failed with exit code {done.returncode}: {done.stderr[-2000:]}")
    return done.stdout.splitlines()[-1]


def train(name: str, *arguments: object) -> dict[str, Any]:
    """Train a rival in a process of its own, see `train.py`; return its results and the versions it ran with."""
    return json.loads(last_line(name, FOLDER / "train.py", name, *arguments))


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "sympol" / "rivals"
