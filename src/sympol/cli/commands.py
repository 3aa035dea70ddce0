"""The commands behind `sympol.cli.app`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from . import show as read
from . import train, watch
from .console import one_line_errors


@one_line_errors()
def _bench(arguments: Sequence[str]) -> int:
    # scipy and scikit-learn take a second to import, which no other command should wait
    from .bench import bench

    return bench(arguments)


def _distill(arguments: Sequence[str]) -> int:
    from .distill import distill

    return distill(arguments)


def _export(arguments: Sequence[str]) -> int:
    from .export import export

    return export(arguments)


def _report(arguments: Sequence[str]) -> int:
    from .report import report

    return report(arguments)


def _compare(arguments: Sequence[str]) -> int:
    from .report import compare

    return compare(arguments)


def _verify(arguments: Sequence[str]) -> int:
    from .verify import verify

    return verify(arguments)


def _explain(arguments: Sequence[str]) -> int:
    from .explain import explain

    return explain(arguments)


def _diff(arguments: Sequence[str]) -> int:
    from .diff import diff

    return diff(arguments)


def _pareto(arguments: Sequence[str]) -> int:
    from .pareto import pareto

    return pareto(arguments)


def _tune(arguments: Sequence[str]) -> int:
    from .tune import tune

    return tune(arguments)


COMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train.train,
    "show": read.show,
    "eval": read.evaluate,
    "watch": watch.watch,
    "export": _export,
    "report": _report,
    "compare": _compare,
    "verify": _verify,
    "explain": _explain,
    "diff": _diff,
    "resume": train.resume,
    "distill": _distill,
    "pareto": _pareto,
    "bench": _bench,
    "tune": _tune,
}
