"""The commands behind `sympol.cli`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import read, train, watch


def _bench(arguments: Sequence[str]) -> int:
    from .bench import (
        bench,
    )  # scipy and scikit-learn take a second to import, which no other command should wait

    return bench(arguments)


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train.train,
    "show": read.show,
    "eval": read.evaluate,
    "watch": watch.watch,
    "export": read.export,
    "resume": train.resume,
    "bench": _bench,
}
