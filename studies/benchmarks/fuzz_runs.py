"""Folders of runs, with files that are changed; for `studies.benchmarks.fuzz`."""

from __future__ import annotations

import hashlib
import json
import struct
import tomllib
import warnings
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, ClassVar

import gymnasium
import numpy as np

import sympol
from sympol.envs.errors import EnvironmentFailure
from sympol.runs.metadata import RunError
from sympol.runs.run import Run
from sympol.trees.export import FORMATS

from .fuzz_ask import Broken
from .fuzz_commands import Box, Content, Folder, Link
from .fuzz_inputs import EVIL, as_bytes, as_toml, changed_document, changed_text


class Runs:
    """Folders of runs: (command, other changed files, changed file, its content)."""

    files = ("config.toml", "metrics.csv", "policy.json", "summary.json", "start.json", "safety.toml")
    outputs = (
        *("report.html", ".report.html.tmp", "tree.svg", "tree.pdf", "tree.onnx", ".metrics.csv.tmp"),
        *(".policy.json.tmp", ".config.toml.tmp", "episode.gif", "checkpoints/foreign.json", "policy.py"),
    )
    readers = ("show", "load", "verify", "explain", "eval", "diff", "compare", "tune")
    """Commands that write nothing into the run."""
    commands: ClassVar[dict[tuple[str, ...], float]] = {
        ("show", "run"): 12,
        ("load",): 12,
        ("verify", "run"): 4,
        ("explain", "run", "--observation", "0", "0", "0.1", "0"): 3,
        ("eval", "run", "--episodes", "1"): 4,
        ("diff", "run", "tree.json", "--episodes", "1"): 3,
        ("resume", "run"): 10,
        ("train", "CartPole-v1", "--run-dir", "run"): 1,
        ("train", "CartPole-v1", "--run-dir", "run", "--overwrite"): 2,
        ("train", "CartPole-v1", "--run-dir", "new", "--start", "run"): 2,
        ("report", "run", "--episodes", "1"): 2,
        ("compare", "run", "mlp", "--episodes", "1"): 1,
        ("watch", "run", "--max-steps", "2"): 0.2,
        ("pareto", "CartPole-v1", "--teacher", "run", "--out", "front"): 1,
        ("tune", "CartPole-v1", "--preset", "run/config.toml"): 1,
        **{("export", "run", "--to", to): 1 for to in (*FORMATS, "svg", "pdf")},
    }

    def __init__(self, scratch: Path) -> None:
        self.box = Box(scratch)
        self.run = {
            name.removeprefix("run/"): content
            for name, content in self.box.files.items()
            if name.startswith("run/")
        }
        self.sealed = sorted(name for name in self.run if name.startswith("checkpoints/"))

    def make(self, dice: Random) -> tuple[tuple[str, ...], dict[str, Content], str, Content]:
        """Change a file or two."""
        others: dict[str, Content] = {}
        for _ in range(dice.choice((0, 0, 0, 0, 1, 2))):
            name = self._name(dice)
            others[name] = self._changed(dice, name, others)
        name = self._name(dice)
        weights = {
            command: 0 if name in self.outputs and command[0] in self.readers else weight
            for command, weight in self.commands.items()
        }
        command = dice.choices([*weights], weights=[*weights.values()])[0]
        return command, others, name, self._changed(dice, name, others)

    def ask(self, given: tuple[tuple[str, ...], dict[str, Content], str, Content]) -> bool:
        """Run the command on the folder."""
        command, others, name, content = given
        changes = {f"run/{other}": its for other, its in {**others, name: content}.items()}
        self.box.fill(changes)
        rows = self._rows()
        answered = self.box.run(command, self._load if command == ("load",) else None)
        if command[0] == "resume" and not any(name.startswith("checkpoints") for name in (*others, name)):
            self._kept(rows)
        return answered

    def _name(self, dice: Random) -> str:
        which = dice.random()
        if which < 0.75:
            return dice.choice(self.files)
        return dice.choice(self.sealed) if which < 0.93 else dice.choice(self.outputs)

    def _changed(self, dice: Random, name: str, others: dict[str, Content]) -> Content:
        was = self.run.get(name, b"")
        how = dice.random()
        if how < 0.12 or name in self.outputs:
            outside = "../../outside"
            up = "../" * name.count("/")
            return dice.choice(
                (
                    *(None, b"", Folder(), Link(f"{up}{outside}/precious.txt"), Link(Path(name).name)),
                    *(Link(f"{up}{outside}/precious.json"), Link(f"{up}missing"), was[: len(was) // 2]),
                    *(b"\xef\xbb\xbf" + was, was.decode("latin-1").encode("utf-16"), b"\xff\x00" + was),
                    *(was.replace(b"\n", b"\r\n"), b"a" * 2_000_000, b"[" * 2_000_000, was * 200),
                )
            )
        if name.endswith(".safetensors"):
            changed = self._tensors(dice, was)
            step = int(Path(name).stem)
            seal = {"timestep": step, "sha256": hashlib.sha256(changed).hexdigest()}
            others[name.replace(".safetensors", ".json")] = json.dumps(seal).encode()
            return changed
        text = was.decode()
        if name.endswith(".json") and how < 0.6:
            return json.dumps(changed_document(dice, json.loads(text))).encode()
        if name.endswith(".toml") and how < 0.6:
            return as_bytes(as_toml(changed_document(dice, tomllib.loads(text))) or "")
        words = ("CartPole-v1", f"{EVIL}:CartPole-v1", "[run]", "format = 1")
        return as_bytes(changed_text(dice, text, words))

    @staticmethod
    def _tensors(dice: Random, content: bytes) -> bytes:
        """Change the header or the numbers; the checksum beside it is made to fit."""
        (length,) = struct.unpack("<Q", content[:8])
        header, numbers = content[8 : 8 + length].decode(), content[8 + length :]
        if dice.random() < 0.3:
            numbers = bytes(
                dice.choice((b ^ 255, b)) for b in numbers[: dice.choice((10, 1000, len(numbers)))]
            )
        elif dice.random() < 0.5:
            header = json.dumps(changed_document(dice, json.loads(header)))
        else:
            header = changed_text(dice, header)
        written = as_bytes(header)
        length = len(written) if dice.random() < 0.9 else dice.choice((0, 1, 2**63, 2**40))
        return struct.pack("<Q", length) + written + numbers

    def _load(self) -> Any:
        """As Python does it; None where it is refused."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                agent = sympol.load("run")
                rows = Run.open(Path("run")).metrics.read()
                if agent.state is not None:
                    agent.predict(np.zeros((2, len(agent.spec.features.names)), np.float32))
                return rows
            except (RunError, ValueError, EnvironmentFailure, ImportError, OSError, gymnasium.error.Error):
                return None

    def _rows(self) -> list[bytes]:
        path, was = self.box.work / "run/metrics.csv", self.run["metrics.csv"]
        content = path.read_bytes() if path.is_file() and not path.is_symlink() else b""
        return [line for line in content.splitlines() if line in was.splitlines()[1:]]

    def _kept(self, rows: Sequence[bytes]) -> None:
        """Raise Broken where numbers of a row are gone: the last checkpoint is later than all."""
        paths = [
            path for path in (self.box.work / "run").glob("*") if "metrics" in path.name and path.is_file()
        ]
        there = [set(line.split(b",")) for path in paths for line in path.read_bytes().splitlines()]
        if lost := [row for row in rows if not any(set(row.split(b",")) <= line for line in there)]:
            raise Broken("resume loses rows of metrics.csv", repr(lost))
