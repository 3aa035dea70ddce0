"""The commands behind `sympol.cli`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import read, train

COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train.train,
    "show": read.show,
    "eval": read.evaluate,
    "export": read.export,
    "resume": train.resume,
}
