"""The command that searches hyperparameters: trials are run, then the best are shown, drawn and kept."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape
from rich.table import Table as Shown

from ..parallel import Failure
from ..results.seeds import SEARCH
from ..runs.metadata import file_name
from ..runs.progress import decimals
from ..threads import use_one_thread
from ..tune.report import (
    best_trials,
    counts,
    importances,
    require_preset_file,
    save_preset,
    write_plots,
)
from ..tune.study import FAILURE, Search, finished
from ..tune.tune import Outcome
from ..tune.tune import tune as run
from .arguments import Tune
from .console import err, one_line_errors, out, print_error, warnings_in_one_line
from .parse import env_kwargs, parse

if TYPE_CHECKING:
    from optuna import Study

_SHOWN = 3
"""So many of the best trials are shown beside each other."""

MOST_SEEDS = 1000
"""Trainings of one trial, at most."""


@one_line_errors()
def tune(arguments: Sequence[str]) -> int:
    """``sympol tune``."""
    given = parse(Tune, "tune", arguments)
    search = _search(given)
    if given.save_preset is not None:
        require_preset_file(given.save_preset)  # now, not after sixty trials
    use_one_thread()
    name = given.study or f"{search.env}-{search.algorithm}-{search.policy}"
    stem = Path("runs", "tune", file_name(name))
    storage = given.storage or str(stem.with_name(f"{stem.name}.journal"))
    if "://" not in storage:
        stem = Path(storage).with_suffix("") if given.study is None else Path(storage).parent / stem.name
    err.print(_plan(given, search, name, storage), markup=False)
    options: dict[str, Any] = {"workers": given.workers, "scheduler": given.scheduler}
    with warnings_in_one_line():
        study, failures = run(search, storage, name, given.trials, on_trial=_tell, **options)
    return _report(given, study, stem, failures)


def _search(given: Tune) -> Search:
    for name in ("trials", "total_timesteps", "seeds", "workers"):
        if getattr(given, name) < 1:
            raise ValueError(f"--{name.replace('_', '-')} must be at least 1, got {getattr(given, name)}")
    if given.seeds > MOST_SEEDS:
        raise ValueError(
            f"--seeds must be at most {MOST_SEEDS:,}, got {given.seeds}: each trial trains with all of them"
        )
    if given.seed not in SEARCH:
        raise ValueError(
            f"--seed must be at least {SEARCH.start}, got {given.seed}: those below are of trainings that are "
            "reported, and nothing is chosen by them"
        )
    return Search.of(
        given.env,
        given.policy,
        given.algorithm,
        total_timesteps=given.total_timesteps,
        seeds=range(given.seed, given.seed + given.seeds),
        preset_name=given.preset,
        env_kwargs=env_kwargs(given.env_kwargs),
    )


def _plan(given: Tune, search: Search, name: str, storage: str) -> str:
    what = {"tree": "a tree", "mlp": "an MLP", "sdt": "a soft tree"}[search.policy]
    seeds = f"seed {search.seeds[0]}" + (f" to {search.seeds[-1]}" if len(search.seeds) > 1 else "")
    where = "PostgreSQL" if "://" in storage else storage  # an address may hold a password
    return (
        f"{given.trials} trials of {what} by {search.algorithm.upper()} on {search.env}, "
        f"{given.total_timesteps:,} steps, {seeds}; study {name} in {where}"
    )


def _tell(outcome: Outcome) -> None:
    match outcome.state:
        case "complete":
            word = f"return {_number(outcome.value)}, the best so far {_number(outcome.best)}"
        case "pruned":
            word = f"pruned at return {_number(outcome.value)}"
        case _:
            word = f"failed: {outcome.failure}"
    err.print(f"trial {outcome.number}: {word}", markup=False)


def _report(given: Tune, study: Study, stem: Path, failures: Sequence[Failure]) -> int:
    for failure in failures:
        print_error(RuntimeError(f"{failure.task.name}: {failure.reason}"))
    best = best_trials(study)
    if not best:
        reasons = [reason for trial in finished(study) if (reason := trial.user_attrs.get(FAILURE))]
        print_error(
            RuntimeError(f"no trial was completed{f'; the last failed: {reasons[-1]}' if reasons else ''}")
        )
        return 1
    out.print(_table(study))
    plots = write_plots(study, stem)
    err.print(f"written to {', '.join(map(str, plots))}", markup=False)
    if given.save_preset is not None:
        save_preset(study, given.save_preset)
        words = ["sympol", "train", given.env, "--preset", str(given.save_preset)]
        words += [
            f"--{name}={getattr(given, name)}" for name in ("algorithm", "policy") if _is_other(given, name)
        ]
        words += ["--env-kwargs", *given.env_kwargs] if given.env_kwargs else []
        err.print(f"the best is in {given.save_preset}; train with it: {shlex.join(words)}", markup=False)
    return 1 if failures else 0


def _is_other(given: Tune, name: str) -> bool:
    return hasattr(given, name) and getattr(given, name) != getattr(Tune, name)


def _table(study: Study) -> Shown:
    """The best trials, a column each, and what mattered."""
    best, shares = best_trials(study)[:_SHOWN], importances(study)
    there = counts(study)
    shown = Shown(
        title=escape(
            f"{study.study_name}: {there['complete']} completed, {there['pruned']} pruned, {there['fail']} failed"
        ),
        caption="importance: share in what sets the best trials apart" if shares else None,
    )
    shown.add_column("", no_wrap=True)
    for trial in best:
        shown.add_column(f"trial {trial.number}", justify="right")
    if shares:
        shown.add_column("importance", justify="right")
    shown.add_row(
        "validation return", *(f"[bold]{_number(trial.value)}[/]" for trial in best), "", end_section=True
    )
    for name in sorted(best[0].params, key=lambda name: -shares.get(name, 0.0)):
        share = [f"{shares[name]:.0%}"] if name in shares else []
        shown.add_row(name, *(_field(trial.params, name) for trial in best), *share)
    return shown


def _field(params: Mapping[str, Any], name: str) -> str:
    value = params[name]
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    value = value or 0.0
    return f"{value:,.{decimals(value)}f}"
