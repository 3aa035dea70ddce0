"""The commands that read a run: eval, show."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from rich.markup import escape

from ..agents import load_run
from ..distill.soft_text import soft_text
from ..distill.soft_view import SoftView
from ..evaluate import evaluate_policy
from ..report import policy_of
from ..runs.metadata import RunError
from ..runs.progress import decimals
from ..runs.run import Run
from ..teachers import kept_soft_view
from .arguments import Eval, Show
from .console import one_line_errors, out, words_of
from .parse import parse


@one_line_errors()
def evaluate(arguments: Sequence[str]) -> int:
    """``sympol eval``."""
    given = parse(Eval, "eval", arguments)
    run = Run.open(given.run, given.env, trust=given.trust)
    spec = run.resolve_env()
    mean, std = evaluate_policy(policy_of(run), spec, given.episodes, seed=given.seed)
    result = {
        "env": spec.name,
        "return_mean": mean,
        "return_std": std,
        "episodes": given.episodes,
        "eval_seed": given.seed,
    }
    if given.json:
        print(json.dumps(result))
    else:
        n = decimals(mean)
        out.print(
            f"{escape(spec.name)}: return [bold]{mean:,.{n}f}[/] ± {std:,.{n}f} over {given.episodes} episodes "
            f"(seed {given.seed})"
        )
    return 0


@one_line_errors()
def show(arguments: Sequence[str]) -> int:
    """``sympol show``."""
    given = parse(Show, "show", arguments)
    run = Run.open(given.run, given.env, trust=given.trust)
    summary = run.load_summary()
    text = soft_text(soft_view(run, summary)) if is_soft(run) else run.load_tree().to_text()
    words = "" if summary is None else words_of(run, summary)
    print(text)
    if words:
        out.print(words)
    return 0


def is_soft(run: Run) -> bool:
    """Whether a run's policy is a soft tree, which is no `DecisionTree`."""
    return run.config.policy == "sdt" and not run.is_distilled


def soft_view(run: Run, summary: dict[str, Any] | None) -> SoftView:
    """The soft tree of a run, as it is written and drawn."""
    agent = load_run(run)
    if agent.state is None:
        raise RunError(f"{run.path} has no soft tree yet; finish it: sympol resume {run.as_argument}")
    try:
        return kept_soft_view(agent, summary)
    except (TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error
