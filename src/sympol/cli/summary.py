"""The text that commands print of a finished run: its summary, and the commands that can follow."""

from __future__ import annotations

import shlex
from typing import Any

from ..algorithms.config import Config
from ..runs.formatting import decimals
from ..runs.metadata import RunError
from ..runs.run import Run
from .console import print_steps, program


def format_summary(run: Run, summary: dict[str, Any]) -> str:
    """Return a run's returns, size and times as lines with rich's markup.

    Args:
        run: The run, for messages.
        summary: Its summary, empty while it is not finished.

    Raises:
        RunError: The summary was edited, and is not a run's.
    """
    try:
        return _lines(summary)
    except (ArithmeticError, KeyError, TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error


def _lines(summary: dict[str, Any]) -> str:
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
            f"the same episodes; there {_agreement(summary)}"
        )
    if "guide" in summary:
        lines.append(_guide(summary["guide"]))
    if "nodes" in summary:
        lines.append(
            f"size     [bold]{summary['nodes']:,}[/] nodes, {summary['leaves']:,} leaves, depth {summary['depth']:,} "
            f"(before pruning {summary['nodes_unpruned']:,} nodes{_limits(summary)})"
        )
    if "training_seconds" in summary:
        lines.append(
            f"time     {summary['wall_seconds']:.1f} s in all: {summary['compile_seconds']:.1f} s compiling, "
            f"{summary['training_seconds']:.1f} s training at {summary['steps_per_second']:,} steps/s"
        )
    if "distill_seconds" in summary:
        lines.append(f"time     {summary['distill_seconds']:.1f} s")
    return "\n".join(lines)


def with_teacher(config: Config) -> str:
    """Return the words about the teacher of a training, if it has one."""
    return ", after an MLP that is its teacher (--method direct: without)" if config.method == "auto" else ""


def _guide(guide: dict[str, Any]) -> str:
    """Return the line about the teacher of a training."""
    earned = [guide[f"{name}_return"] for name in ("teacher", "distilled", "random")]
    n = decimals(max(earned, key=abs))
    teacher, distilled, random = (f"{number:,.{n}f}" for number in earned)
    return (
        f"teacher  an MLP earned {teacher} after {guide['teacher_timesteps']:,} steps (random actions {random}), "
        f"trees distilled from it in {guide['distill_timesteps']:,} more {distilled}; then {guide['began_with']} was "
        "trained"
    )


def _limits(summary: dict[str, Any]) -> str:
    most = f"; {summary['max_nodes']:,} were allowed" if "max_nodes" in summary else ""
    return most + (f"; a node had to be worth {summary['node_price']:g}" if "node_price" in summary else "")


def _agreement(summary: dict[str, Any]) -> str:
    if "agreement" in summary:
        return f"the tree acts as it does in {summary['agreement']:.1%} of its observations".replace(
            "%", " %"
        )
    return f"the tree's actions are {summary['action_difference']:.3g} from its own on average"


def print_next(finished: Run) -> None:
    """Print the commands that can follow a training or a distillation."""
    sympol, path, run, played = (
        program(),
        finished.path,
        shlex.quote(str(finished.path)),
        finished.as_argument,
    )
    steps = [(f"{sympol} eval {played} --episodes 100 --seed 7", "more test episodes")]
    if finished.has_tree:
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
