"""The commands that read a run: eval, show, export."""

from __future__ import annotations

import json
from collections.abc import Sequence

from rich.markup import escape

from ..agents import Agent, load
from ..evaluate import evaluate_policy
from ..runs.folder import Run, RunError
from ..runs.progress import decimals
from ..trees import DecisionTree
from .arguments import Eval, Export, Show, parse
from .say import err, one_line_errors, out, summary_words


def policy_of(run: Run) -> Agent | DecisionTree:
    """What acts: the tree, which needs nothing else to be read, or the agent whose policy is none."""
    return run.load_tree() if run.has_tree else load(run.path)


@one_line_errors()
def evaluate(arguments: Sequence[str]) -> int:
    """``sympol eval``."""
    given = parse(Eval, "eval", arguments)
    run = Run.open(given.run)
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
    run = Run.open(given.run)
    tree, summary = run.load_tree(), run.load_summary()
    try:
        words = "" if summary is None else summary_words(summary)
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error
    out.print(tree.to_text(), markup=False)
    if words:
        out.print(words)
    return 0


@one_line_errors()
def export(arguments: Sequence[str]) -> int:
    """``sympol export``."""
    given = parse(Export, "export", arguments)
    run = Run.open(given.run)
    tree = run.load_tree()
    texts = {"python": tree.to_python, "json": tree.to_json, "text": tree.to_text}
    to_text = texts.get(given.to)
    if to_text is not None and given.out is None:
        print(to_text())
        return 0
    path = given.out or run.path / f"tree.{given.to}"
    try:
        if to_text is not None:
            path.write_text(to_text() + "\n", encoding="utf-8")
        else:
            tree.plot(path.with_suffix(f".{given.to}"))
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}; choose another --out") from error
    err.print(f"written to {path}", markup=False)
    return 0
