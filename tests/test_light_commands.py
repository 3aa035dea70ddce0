"""Commands that only read a tree wait for nothing that they do not use."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sympol.cli.app import COMMANDS

from .tiny import quick_compiles, trained

__all__ = ["quick_compiles"]

HEAVY = (
    "jax",
    "equinox",
    "optax",
    "gymnasium",
    "matplotlib",
    "scipy",
    "sklearn",
    "optuna",
    "numba",
    "PIL",
    "safetensors",
)
SLOW = ("typeguard", "importlib.metadata")
"""Modules that tyro imports for some types of arguments; a twelfth of a second each."""
READERS = ("show", "verify", "explain", "export", "diff")
OBSERVATION = ("--observation", "0", "0", "0.1", "0")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("light") / "run"
    trained().save(path)
    return path


LARGEST = 60
"""Megabytes of memory of a command that only reads, at most."""


def imported(*words: object) -> set[str]:
    """Run a command in a process of its own, in little memory; return the heavy modules that it imported.

    For a command that only reads a tree, slow modules count as heavy, too.
    """
    unwanted = (*HEAVY, *SLOW) if words and words[0] in READERS else HEAVY
    code = (
        "import json, sys\nfrom sympol.cli.app import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as stop:\n    assert stop.code in (0, 1, 2)\n"
        "status = open('/proc/self/status').read() if sys.platform == 'linux' else 'VmHWM: 0'\n"
        "megabytes = int(status.partition('VmHWM:')[2].split()[0]) / 1024\n"
        f"print(json.dumps([megabytes, [name for name in {unwanted} if name in sys.modules]]), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    megabytes, modules = json.loads(done.stderr.splitlines()[-1])
    assert megabytes < LARGEST
    return set(modules)


@pytest.mark.usefixtures("quick_compiles")
@pytest.mark.parametrize(
    "words",
    [
        ("show", "RUN"),
        ("verify", "RUN"),
        ("verify", "RUN", "--property", "when pole angle > 0.1 then action is push right"),
        ("explain", "RUN", *OBSERVATION),
        ("diff", "RUN", "RUN"),
        *(
            ("export", "RUN", "--to", to)
            for to in ("python", "c", "rust", "javascript", "sql", "text", "json")
        ),
        ("export", "RUN", "--out", "EMPTY", "--to", "package"),
        ("show", "no-run"),
    ],
    ids=" ".join,
)
def test_reading_a_tree_imports_nothing_heavy(run, words, tmp_path):
    places = {"RUN": run, "EMPTY": tmp_path / "package"}
    assert imported(*(places.get(word, word) for word in words)) == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_help_imports_nothing_heavy(command):
    assert imported(command, "--help") == set()


@pytest.mark.parametrize(
    "words", [(), ("--version",), ("shwo",), ("show", "--no-flag"), ("train", "x", "--sede", "1")]
)
def test_a_typing_error_is_told_at_once(words):
    assert imported(*words) == set()
