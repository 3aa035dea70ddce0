"""What commands are told; for `studies.benchmarks.fuzz`."""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, ClassVar, Literal, get_args, get_origin

from sympol.algorithms.config import Config
from sympol.cli import app

from .fuzz_commands import Box
from .fuzz_inputs import as_argument, changed_list, changed_text


class Flags:
    """What a command is told: (its words)."""

    kinds: ClassVar[dict[str, type]] = {
        name: getattr(import_module(f"sympol.cli.{name}"), name.capitalize()) for name in app.COMMANDS
    }
    valid: ClassVar[dict[str, tuple[str, ...]]] = {
        "train": ("CartPole-v1", "--run-dir", "new"),
        "check": ("CartPole-v1",),
        "resume": ("run",),
        "show": ("run",),
        "eval": ("run", "--episodes", "1"),
        "watch": ("run", "--max-steps", "2"),
        "bench": ("control-ppo", "--list"),
        "distill": ("mlp", "--episodes", "1", "--iterations", "1", "--eval-episodes", "1"),
        "tune": ("CartPole-v1",),
        "pareto": ("CartPole-v1",),
        "verify": ("run",),
        "explain": ("run", "--observation", "0", "0", "0.1", "0"),
        "diff": ("run", "tree.json"),
        "export": ("run", "--to", "text"),
        "report": ("run", "--episodes", "1"),
        "compare": ("run", "mlp", "--episodes", "1"),
    }
    slow = ("watch", "bench", "distill")
    integers = (*("0", "1", "2", "3", "-1", "7", "1000", "1e6", "1.5", "abc", "0x10", "1_0", "", "١", "3"),)
    huge = ("2147483648", "9223372036854775808", "9" * 30, "9" * 5000)
    floats = (*("0", "0.5", "1", "-1", "1e-9", "1e999", "nan", "inf", "-inf", "1e39", "abc", ""),)
    paths = (
        *(
            "run",
            "mlp",
            "run/policy.json",
            "tree.json",
            "tree.txt",
            "missing",
            "folder",
            "note.txt",
            "new",
            "",
        ),
        *(
            ".",
            "run/config.toml",
            "a" * 300,
            "new/deeper/x",
            "x\udcff",
            "tree.json/x",
            "run/checkpoints",
            "-",
        ),
        *("out.html", "out.txt", "out.png", "out.0.1", "out.gif", "\x1b[31mred", "new.toml", "missing.json"),
    )
    strings = (
        *(
            "CartPole-v1",
            "Pendulum-v1",
            "MiniGrid-Empty-5x5-v0",
            "cartpole-v1",
            "No-v0",
            ":",
            "a:b",
            "x=1",
            "=1",
        ),
        *(
            "json:X-v0",
            "CartPole-v1:",
            "FrozenLake-v1",
            "pole angle > 0.1",
            "pole angle=0.1",
            "cart position",
        ),
        *("when pole angle > 0.1 then action is push right", "5m", "50M steps", "-1m", "1e9h", "1e400 steps"),
        *(
            "paper",
            "default",
            "tree",
            "tree-paper",
            "viper-5",
            "all",
            "control-ppo",
            "static-batch",
            "python",
            "c",
        ),
        *("is_slippery=False", "view_size=5", "size=[1,2", "a=" + "[" * 3000, "sutton_barto_reward=true"),
        *(
            "render_mode=rgb_array",
            "0.1",
            "1",
            "\x1b[31m",
            "[bold]x",
            "mine=missing:train",
            "a" * 3000,
            "svg",
        ),
    )

    def __init__(self, scratch: Path) -> None:
        self.box = Box(scratch)

    def make(self, dice: Random) -> tuple[list[str]]:
        """Add flags to what is right, and change words."""
        command = dice.choice([*self.kinds])
        if command in self.slow and dice.random() < 0.8:
            command = dice.choice([name for name in self.kinds if name not in self.slow])
        words = [command, *self.valid[command]]
        for _ in range(dice.choice((0, 1, 1, 2, 3))):
            words += self._flag(dice, command)
        if dice.random() < 0.3:
            words = changed_list(dice, words)
        if dice.random() < 0.3:
            at = dice.randrange(len(words))
            words[at] = changed_text(dice, words[at], self.strings)
        given = map(as_argument, words)
        return ([word for word in given if word is not None and not _leads_away(word)],)

    def ask(self, given: tuple[list[str]]) -> bool:
        """Run it."""
        (words,) = given
        if not words or any(map(_leads_away, words)):
            return False
        self.box.fill({})
        return self.box.run(words)

    def _flag(self, dice: Random, command: str) -> list[str]:
        kinds = (self.kinds[command], Config) if command == "train" else (self.kinds[command],)
        hints = {name: hint for kind in kinds for name, hint in _hints(kind) if name != "config"}
        name = dice.choice([*hints])
        flag = "--" + name.replace("_", "-")
        values = self._values(dice, hints[name])
        if len(values) == 1 and dice.random() < 0.2:
            return [f"{flag}={values[0]}"]
        return [flag, *values]

    def _values(self, dice: Random, hint: Any) -> list[str]:
        if get_origin(hint) in (typing.Union, types.UnionType):
            hint = dice.choice([one for one in get_args(hint) if one is not type(None)])
        if get_origin(hint) is tuple:
            return [
                value
                for _ in range(dice.choice((0, 1, 2, 3)))
                for value in self._values(dice, get_args(hint)[0])
            ]
        if get_origin(hint) is Literal:
            return [dice.choice((*get_args(hint), *get_args(hint), "none", ""))]
        if hint is bool:
            return [] if dice.random() < 0.9 else ["true"]
        if hint is int:
            return [dice.choice(self.huge if dice.random() < 0.1 else self.integers)]
        choices = {float: self.floats, Path: self.paths}.get(hint, self.strings)
        return [dice.choice(choices if dice.random() < 0.9 else self.strings)]


def _hints(kind: Any) -> Iterator[tuple[str, Any]]:
    """Yield the names and types of a command's arguments, those of groups included."""
    for name, hint in typing.get_type_hints(kind).items():
        if dataclasses.is_dataclass(hint):
            yield from _hints(hint)
        else:
            yield name, hint


def _leads_away(word: str) -> bool:
    """Whether a word may name a place beyond the folder; a fuzzer had better not write there."""
    return re.search(r"(^|[=\s])[/~]|\.\.", word) is not None
