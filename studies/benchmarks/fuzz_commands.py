"""Commands as `studies.benchmarks.fuzz` runs them: in this process, in a folder of their own, by the rule for each.

What would take long begins, and that is its answer: trainings, searches and tables are not run.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import traceback
import unicodedata
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import jax
from tests.tiny import TINY, flags

import sympol
from sympol.cli.app import main

from .fuzz_ask import Broken, TooLong
from .fuzz_inputs import EVIL

WORK = ("cli.learn:learn", "bench.run:run", "tune.tune:tune", "search.front.search:search")
"""Functions, as the commands know them, that begin what was asked for."""
LONG = ("play.py", "film", "distill", "report")
"""Where a command may be when it has taken long without breaking the rule: many episodes were asked for."""
OUTPUTS = re.compile(r"(tree|report|episode|front|compare)\.\w+|distilled|runs|results|docs")
"""What commands write by default."""
PRECIOUS = "what must not change\n"

_WARNING = re.compile(r"^\S.*:\d+: \w*Warning: ", re.MULTILINE)


class Said(NamedTuple):
    """What a command did."""

    status: int
    out: str
    err: str


class Began(BaseException):
    """What was asked for has begun."""


@dataclass(frozen=True)
class Link:
    """In place of a file, a symbolic link."""

    target: str


@dataclass(frozen=True)
class Folder:
    """In place of a file, a folder with something in it."""


Content = bytes | Link | Folder | None
"""Of a file; None is none."""


def terminal(words: str, whose: str) -> None:
    """Raise Broken where a terminal would be told more than text."""
    for character in set(words):
        if unicodedata.category(character) == "Cc" and character not in "\n\t":
            at = words.index(character)
            raise Broken(
                f"control character on the terminal, of {whose}", repr(words[max(0, at - 60) : at + 30])
            )


def call(arguments: Sequence[str]) -> Said:
    """Run a command in this process, what it begins left out."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    streams = {"stdout": out, "stderr": err, "stdin": io.StringIO()}
    environment = dict(os.environ)
    try:
        with contextlib.ExitStack() as stack:
            for name, stream in streams.items():
                stack.enter_context(patch.object(sys, name, stream))
            for work in WORK:
                module, function = work.split(":")
                module = import_module(f"sympol.{module}")
                stack.enter_context(patch.object(module, function, _begin))
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("default")
            status = _status(arguments)
    finally:
        os.environ.clear()
        os.environ.update(environment)
    for stream in (out, err):
        stream.flush()
    return Said(status, *(stream.buffer.getvalue().decode() for stream in (out, err)))  # pyright: ignore[reportAttributeAccessIssue]


def _begin(*_: Any, **__: Any) -> None:
    raise Began


def _status(arguments: Sequence[str]) -> int:
    try:
        return main(arguments)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except Began:
        return 0
    except TooLong as stop:
        files = [Path(frame.f_code.co_filename).parts for frame, _ in traceback.walk_tb(stop.__traceback__)]
        if any(part in file for file in files for part in LONG):
            return 0
        raise


def ruled(arguments: Sequence[str], said: Said) -> None:
    """Raise Broken where a command ended otherwise than it may."""
    name = arguments[0] if arguments else ""
    lines = said.err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    terminal(said.out + said.err, name)
    if "Traceback (most recent call last)" in said.err:
        raise Broken(f"traceback of {name}", said.err)
    if said.status not in (0, 1, 2):
        raise Broken(f"status {said.status} of {name}", said.err)
    if _WARNING.search(said.err):
        raise Broken(f"a warning with its line of code, of {name}", said.err)
    if said.status == 2 and len(errors) != 1:
        raise Broken(f"{len(errors)} error lines of {name}", said.err)
    if said.status == 1 and not errors and name != "verify":  # whose answer it is where something fails
        raise Broken(f"status 1 of {name} without an error line", said.err)


class Box:
    """A folder to run commands in: runs, trees, and beside it what nobody may touch.

    ``made`` holds the runs, which are trained once; ``work`` is where commands are run, and is as before each time.
    """

    def __init__(self, scratch: Path) -> None:
        self.made, self.work, self.outside = (scratch / name for name in ("made", "work", "outside"))
        if not self.made.exists():
            _make(scratch / "making")
            (scratch / "making").rename(self.made)
        self.files = {str(path.relative_to(self.made)): path.read_bytes() for path in _files(self.made)}
        self.outside.mkdir(exist_ok=True)

    def fill(self, changes: dict[str, Content]) -> None:
        """Make the folders as they are at first, but for some files."""
        shutil.rmtree(self.work, ignore_errors=True)
        shutil.copytree(self.made, self.work)
        for name in ("precious.txt", "precious.json", "000000009999.json"):
            (self.outside / name).write_text(PRECIOUS)
        for name, content in changes.items():
            put(self.work / name, content)

    def run(self, arguments: Sequence[str], ask: Callable[[], Any] | None = None) -> bool:
        """Run a command, or ``ask``, there; whether it was answered. Raises Broken where the rule is."""
        before, modules = contents(self.work), set(sys.modules)
        with _inside(self.work):
            if ask is None:
                said = call(arguments)
                ruled(arguments, said)
                refused = said.status == 2
            else:
                refused = ask() is None
        after = contents(self.work)
        if EVIL in sys.modules.keys() - modules:
            del sys.modules[EVIL]
            raise Broken(f"{arguments[0]} imports what a file names")
        for path in self.outside.iterdir():
            if path.read_text() != PRECIOUS:
                raise Broken(f"{arguments[0]} writes through a link", path.name)
        if len([*self.outside.iterdir()]) != 3:
            raise Broken(f"{arguments[0]} writes or removes files outside its folder")
        changed = {name for name in before if after.get(name) != before[name]}
        if refused and (before != after):
            raise Broken(
                f"{arguments[0]} refuses, and writes", repr(sorted(changed | (after.keys() - before)))
            )
        lost = [name for name in changed if not self._may_change(name, arguments)]
        if lost:
            raise Broken(f"{arguments[0]} changes what it reads", repr(sorted(lost)))
        return not refused

    def _may_change(self, name: str, arguments: Sequence[str]) -> bool:
        written = {"train", "resume", "distill", "pareto", "bench", "tune"}
        return (
            arguments[0] in written
            or bool(OUTPUTS.match(Path(name).name) or OUTPUTS.match(name))
            or any(name in argument for argument in arguments)
        )


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before, path = Path.cwd(), [*sys.path]
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        os.chdir(before)
        sys.path[:] = path


def put(path: Path, content: Content) -> None:
    """Make a file what it is to be, whatever is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    match content:
        case bytes():
            path.write_bytes(content)
        case Link(target):
            path.symlink_to(target)
        case Folder():
            path.mkdir()
            (path / "note.txt").write_text(PRECIOUS)


def contents(folder: Path) -> dict[str, object]:
    """What is in a folder: links as such, of files what they hold."""
    found: dict[str, object] = {}
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = path.read_bytes()
    return {name: content for name, content in found.items() if "__pycache__" not in name}


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def _make(folder: Path) -> None:
    """Train a tree from a tree, so that the run has every file that a run can have, and an MLP; write trees beside."""
    folder.mkdir(parents=True)
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", True)  # of no use to a moment of training
    tree = sympol.DecisionTree.from_json(
        (Path(__file__).parents[2] / "tests/golden/trees/cartpole.json").read_text(encoding="utf-8")
    )
    spec = sympol.resolve("CartPole-v1")
    tree = replace(tree, actions=spec.actions, **spec.features.metadata())
    (folder / "tree.json").write_text(tree.to_json(), encoding="utf-8")
    words = ["train", "CartPole-v1", "--eval-episodes", "2"]
    small = {name: value for name, value in TINY.items() if name != "depth"}
    runs = {
        "run": ["--start", "tree.json", *flags(TINY)],
        "mlp": ["--policy", "mlp", "--actor-hidden", "4", *flags(small)],
    }
    try:
        with (
            _inside(folder),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            for name, more in runs.items():
                if main([*words, *more, "--run-dir", name]) != 0:
                    raise RuntimeError(f"the run {name} cannot be made")
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
    trained = sympol.DecisionTree.from_json((folder / "run/policy.json").read_text(encoding="utf-8"))
    rule = '[[property]]\nname = "a rule"\nrule = "when pole angle > 0.1 then action is push right"\n'
    (folder / "run/safety.toml").write_text(rule, encoding="utf-8")
    (folder / "tree.txt").write_text(f'+++\nenv = "CartPole-v1"\n+++\n{trained}\n', encoding="utf-8")
    (folder / "note.txt").write_text("a note\n")
    (folder / "folder").mkdir()
    (folder / f"{EVIL}.py").write_text("")
