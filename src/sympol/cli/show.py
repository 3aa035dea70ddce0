"""``sympol show``: the tree of a run, and its summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..runs.metadata import RunError
from ..runs.run import Run
from .arguments import Folder, PlaysRun, parse
from .console import out
from .summary import format_summary

if TYPE_CHECKING:
    from ..distill.soft_view import SoftView


@dataclass
class Show(PlaysRun):
    """Print the tree of a run as text, and its summary."""

    run: Folder
    """The run's folder."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol show``."""
    given = parse(Show, "show", words)
    shown = Run.open(given.run, given.env, trust=given.trust)
    summary = shown.load_summary()
    if is_soft(shown):
        from ..distill.soft_text import soft_text

        text = soft_text(soft_view(shown, summary))
    else:
        text = shown.load_tree().to_text()
    lines = "" if summary is None else format_summary(shown, summary)
    print(text)
    if lines:
        out.print(lines)
    return 0


def is_soft(run: Run) -> bool:
    """Return whether a run's policy is a soft tree, which is no `DecisionTree`."""
    return run.config.policy == "sdt" and not run.is_distilled


def soft_view(run: Run, summary: dict[str, Any] | None) -> SoftView:
    """Return the soft tree of a run, as it is written and drawn.

    Raises:
        RunError: There is none yet, or the summary is not a run's.
    """
    from ..agents import load_run
    from ..teachers import kept_soft_view

    agent = load_run(run)
    if agent.state is None:
        raise RunError(f"{run.path} has no soft tree yet; finish it: sympol resume {run.as_argument}")
    try:
        return kept_soft_view(agent, summary)
    except (TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error
