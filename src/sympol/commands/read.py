"""The commands that read a run: eval, show, export."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from rich.markup import escape

from ..agents import load
from ..distill.picture import plot_soft_tree
from ..distill.soft_text import soft_text
from ..distill.soft_view import SoftView
from ..evaluate import evaluate_policy
from ..reports import policy_of
from ..runs.about import RunError
from ..runs.folder import Run
from ..runs.progress import decimals
from ..teachers import kept_soft_view
from ..trees import DecisionTree
from ..trees.export import FORMATS
from .arguments import Eval, Export, Show
from .parse import parse
from .say import err, one_line_errors, out, summary_words

PICTURES = ("svg", "pdf", "png")
Texts: TypeAlias = Mapping[str, Callable[[], str | bytes]]
Draw: TypeAlias = Callable[[Path], object]


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
    summary = run.load_summary()
    text = soft_text(_soft(run, summary)) if _is_soft(run) else run.load_tree().to_text()
    try:
        words = "" if summary is None else summary_words(summary)
    except (KeyError, TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error
    out.print(text, markup=False)
    if words:
        out.print(words)
    return 0


@one_line_errors()
def export(arguments: Sequence[str]) -> int:
    """``sympol export``."""
    given = parse(Export, "export", arguments)
    run = Run.open(given.run)
    texts, draw = _soft_forms(run) if _is_soft(run) else _forms(run.load_tree())
    write = texts.get(given.to)
    if write is None and given.to not in PICTURES:
        raise RunError(
            f"{run.path} holds a soft tree, which is written as {', '.join((*texts, *PICTURES))}, not {given.to}; make "
            f"a hard one of it: sympol distill {run.path}"
        )
    written = None if write is None else write()
    if isinstance(written, str) and given.out is None:
        print(written)
        return 0
    path = given.out or run.path / f"tree.{given.to}"
    try:
        if isinstance(written, str):
            path.write_text(written + "\n", encoding="utf-8")
        elif written is not None:
            path.write_bytes(written)
        else:
            draw(path.with_suffix(f".{given.to}"))
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}; choose another --out") from error
    err.print(f"written to {path}", markup=False)
    return 0


def _forms(tree: DecisionTree) -> tuple[Texts, Draw]:
    return {name: partial(form.write, tree) for name, form in FORMATS.items()}, tree.plot


def _is_soft(run: Run) -> bool:
    return run.config.policy == "sdt" and not run.is_distilled


def _soft(run: Run, summary: dict[str, Any] | None) -> SoftView:
    agent = load(run.path)
    if agent.state is None:
        raise RunError(f"{run.path} has no soft tree yet; finish it: sympol resume {run.path}")
    try:
        return kept_soft_view(agent, summary)
    except (TypeError, ValueError) as error:
        raise RunError(f"{run.path / 'summary.json'} is not a run's summary: {error!r}") from error


def _soft_forms(run: Run) -> tuple[Texts, Draw]:
    view = _soft(run, run.load_summary())
    return {"text": lambda: soft_text(view)}, lambda path: plot_soft_tree(view, path)
