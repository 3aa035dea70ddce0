"""The commands behind `sympol.cli`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import read, train, watch

COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train.train,
    "show": read.show,
    "eval": read.evaluate,
    "export": read.export,
    "watch": watch.watch,
    "resume": train.resume,
}
