"""The commands behind `sympol.cli`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import read, train, watch

COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train.train,
    "show": read.show,
    "eval": read.evaluate,
    "watch": watch.watch,
    "export": read.export,
    "resume": train.resume,
}
