"""What is said on the terminal: results on the standard output, everything else on the error stream."""

from __future__ import annotations

import contextlib
import os
import shlex
import shutil
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
from rich.console import (
    Console,
    ConsoleOptions,
    ConsoleRenderable,
    RenderableType,
    RenderHook,
    RenderResult,
)
from rich.markup import escape
from rich.segment import Segment

from ..envs.host import EnvironmentFailure
from ..interrupts import interrupts
from ..parallel import TasksFailed
from ..runs.metadata import RunError, WriteError
from ..runs.progress import decimals
from ..runs.run import Run
from ..trees.floats import printable


class _Printable:
    """What is printed, without escape sequences of its own: a file's names must not write to the terminal."""

    def __init__(self, content: RenderableType) -> None:
        self._content = content

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Write control characters as escapes such as ``\\x1b``."""
        for segment in console.render(self._content, options):
            text = segment.text
            if segment.control or all(c.isprintable() or c == "\n" for c in text):
                yield segment
            else:
                yield Segment("\n".join(map(printable, text.split("\n"))), segment.style)


class _PrintableHook(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Wrap all."""
        return [_Printable(one) for one in renderables]


out = Console(soft_wrap=True, highlight=False, emoji=False)
err = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
for _console in (out, err):
    _console.push_render_hook(_PrintableHook())


@contextlib.contextmanager
def one_line_errors() -> Iterator[None]:
    """Bad input is one line on the error stream and status 2; failures are, with status 1, and Ctrl-C, with 130."""
    try:
        try:
            with warnings_in_one_line():
                yield
        except Exception:
            interrupts.check()  # Ctrl-C during an import, say, can come out as another error
            raise
    except WriteError as error:
        print_error(error)
        raise SystemExit(1) from None
    except (RunError, ValueError) as error:  # ConfigError and UnknownEnvironment are ValueErrors
        print_error(error)
        raise SystemExit(2) from None
    except (EnvironmentFailure, TasksFailed, ImportError, gymnasium.error.Error, OSError) as error:
        print_error(error)
        raise SystemExit(1) from None
    except MemoryError as error:
        print_error(f"out of memory: {error}" if str(error) else "out of memory")
        raise SystemExit(1) from None
    except KeyboardInterrupt:
        print_stopped("interrupted")
        raise SystemExit(interrupts.status) from None


def print_error(error: BaseException | str) -> None:
    """What ends a command, as one line."""
    err.print(f"[bold red]error:[/] {_one_line(error)}")


def print_warning(warning: Warning | str) -> None:
    """What does not end it, idem."""
    err.print(f"[bold yellow]warning:[/] {_one_line(warning)}")


def print_stopped(line: str) -> None:
    """The line that ends a command after Ctrl-C, unless there has been one."""
    if interrupts.take_last_word():
        err.print(line, markup=False)


@contextlib.contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """What is warned of meanwhile is said as it comes, without the line of code that warned."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: print_warning(message)
        yield


def _one_line(message: object) -> str:
    return escape(" ".join(str(message).split()))


def words_of(run: Run, summary: dict[str, Any]) -> str:
    """Return `summary_words` of a summary that was read from a run's folder.

    Raises:
        RunError: it is not a run's summary.
    """
    try:
        return summary_words(summary)
    except (ArithmeticError, KeyError, TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error


def summary_words(summary: dict[str, Any]) -> str:
    """What a run earned, its size and its time; everything put in is a number."""
    lines = [""]
    if "return_mean" in summary:
        n = decimals(summary["return_mean"])
        sampled = summary.get("sampled_return_mean")
        lines.append(
            f"return   [bold]{summary['return_mean']:,.{n}f}[/] ± {summary['return_std']:,.{n}f} over "
            f"{summary['episodes']:,} test episodes on Gymnasium"
            + ("" if sampled is None else f" (sampling its actions: {sampled:,.{n}f})")
        )
    if "teacher_return_mean" in summary:
        n = decimals(summary["teacher_return_mean"])
        lines.append(
            f"teacher  [bold]{summary['teacher_return_mean']:,.{n}f}[/] ± {summary['teacher_return_std']:,.{n}f} over "
            f"the same episodes; there {_likeness_words(summary)}"
        )
    if "nodes" in summary:
        lines.append(
            f"size     [bold]{summary['nodes']:,}[/] nodes, {summary['leaves']:,} leaves, depth {summary['depth']:,} "
            f"(before pruning {summary['nodes_unpruned']:,} nodes{_limit_words(summary)})"
        )
    if "training_seconds" in summary:
        lines.append(
            f"time     {summary['wall_seconds']:.1f} s in all: {summary['compile_seconds']:.1f} s compiling, "
            f"{summary['training_seconds']:.1f} s training at {summary['steps_per_second']:,} steps/s"
        )
    if "distill_seconds" in summary:
        lines.append(f"time     {summary['distill_seconds']:.1f} s")
    return "\n".join(lines)


def _limit_words(summary: dict[str, Any]) -> str:
    most = f"; {summary['max_nodes']:,} were allowed" if "max_nodes" in summary else ""
    return most + (f"; a node had to be worth {summary['node_price']:g}" if "node_price" in summary else "")


def _likeness_words(summary: dict[str, Any]) -> str:
    if "agreement" in summary:
        return f"the tree acts as it does in {summary['agreement']:.1%} of its observations".replace(
            "%", " %"
        )
    return f"the tree's actions are {summary['action_difference']:.3g} from its own on average"


def print_next(of: Run) -> None:
    """Print what can be done with a run."""
    sympol, path, run, played = program(), of.path, shlex.quote(str(of.path)), of.as_argument
    steps = [(f"{sympol} eval {played} --episodes 100 --seed 7", "more test episodes")]
    if of.has_tree:
        steps = [
            (f"{sympol} show {run}", "this tree again"),
            *steps,
            (f"{sympol} report {played}", "a page: the tree at work, its rules, its episodes"),
            (f"{sympol} watch {played}", "a film of an episode beside the tree"),
            (f"{sympol} export {run} --to python", "the policy as a program without dependencies"),
            (str(path / "tree.svg"), "the picture"),
        ]
    else:
        steps.append((f"{sympol} distill {played}", "a decision tree made of it"))
        if (path / "tree.svg").exists():
            show = (f"{sympol} show {played}", "this soft tree again")
            steps = [show, *steps, (str(path / "tree.svg"), "its picture")]
    print_steps(steps)


def program() -> str:
    """How this program was called, so that it can be pasted: by `make train` it is not on the PATH."""
    called = Path(sys.argv[0])
    on_path = called.name != "sympol" or shutil.which("sympol")
    return "sympol" if on_path else shlex.quote(os.path.relpath(called))


def print_steps(steps: Sequence[tuple[str, str]]) -> None:
    """Commands, or files, and what they are for."""
    width = max(len(command) for command, _ in steps)
    out.print()
    for command, what in steps:
        out.print(f"  {command.ljust(width)}  {what}", style="dim", markup=False)
