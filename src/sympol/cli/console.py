"""Errors and warnings of commands, each in one line on the error stream."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.markup import escape

from ..console import err, out
from ..interrupts import interrupts
from ..runs.metadata import RunError, WriteError

__all__ = [
    "err",
    "one_line_errors",
    "out",
    "print_error",
    "print_steps",
    "print_stopped",
    "print_warning",
    "program",
]


@contextlib.contextmanager
def one_line_errors() -> Iterator[None]:
    """Turn every expected exception into one line and an exit status, and every warning into one line.

    Raises:
        SystemExit: Status 2 after bad input, 1 after a failure, 130 after Ctrl-C.
    """
    try:
        try:
            with warnings.catch_warnings():
                warnings.showwarning = lambda message, *_, **__: print_warning(message)
                yield
        except Exception:
            interrupts.check()  # Ctrl-C during an import, say, can come out as another error
            raise
    except KeyboardInterrupt:
        print_stopped("interrupted")
        raise SystemExit(interrupts.status) from None
    except MemoryError as error:
        print_error(f"out of memory: {error}" if str(error) else "out of memory")
        raise SystemExit(1) from None
    except Exception as error:
        status = _status(error)
        if status is None:
            raise
        print_error(error)
        raise SystemExit(status) from None


def _status(error: Exception) -> int | None:
    """Return the exit status after an exception, or None for one that nobody expected."""
    if isinstance(error, WriteError):
        return 1
    if isinstance(error, RunError | ValueError):  # ConfigError and UnknownEnvironment are ValueErrors
        return 2
    if isinstance(error, ImportError | OSError):
        return 1
    # what was raised by these has imported them already
    import gymnasium

    from ..envs.errors import EnvironmentFailure
    from ..parallel import TasksFailed

    return 1 if isinstance(error, EnvironmentFailure | TasksFailed | gymnasium.error.Error) else None


def print_error(error: BaseException | str) -> None:
    """Print the line that ends a command."""
    err.print(f"[bold red]error:[/] {_one_line(error)}")


def print_warning(warning: Warning | str) -> None:
    """Print a line about something that does not end the command."""
    err.print(f"[bold yellow]warning:[/] {_one_line(warning)}")


def print_stopped(line: str) -> None:
    """Print the line that ends a command after Ctrl-C, unless one was printed."""
    if interrupts.take_last_word():
        err.print(line, markup=False)


def _one_line(message: object) -> str:
    return escape(" ".join(str(message).split()))


def program() -> str:
    """Return how this program was called, so that it can be pasted: in a virtual environment it is not on the PATH."""
    called = Path(sys.argv[0])
    on_path = called.name != "sympol" or shutil.which("sympol")
    return "sympol" if on_path else shlex.quote(os.path.relpath(called))


def print_steps(steps: Sequence[tuple[str, str]]) -> None:
    """Print commands or files, and what each is for."""
    width = max(len(command) for command, _ in steps)
    out.print()
    for command, purpose in steps:
        out.print(f"  {command.ljust(width)}  {purpose}", style="dim", markup=False)
