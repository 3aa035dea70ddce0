"""``sympol tune``: a search for hyperparameters."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.markup import escape
from rich.table import Table as Shown

from ..algorithms.presets import DEFAULT
from ..runs.formatting import decimals
from ..runs.metadata import file_name
from ..threads import use_one_thread
from .arguments import EnvKwargs, Text, env_kwargs, parse
from .console import err, out, print_error

if TYPE_CHECKING:
    from optuna import Study

    from ..parallel import Failure
    from ..tune.study import Search
    from ..tune.tune import Outcome

_SHOWN = 3
"""So many of the best trials are shown beside each other."""

MOST_SEEDS = 1000
"""Trainings of one trial, at most."""


@dataclass
class Tune:
    """Search hyperparameters for an environment and a policy: trials in the paper's grids, by validation returns.

    All is kept in a study; what was interrupted goes on, and more --trials add to it. Hopeless trials are pruned.

    The best as a preset: sympol tune CartPole-v1 --save-preset best.toml

    Training with it: sympol train CartPole-v1 --preset best.toml
    """

    env: Text
    """Gymnasium id, such as CartPole-v1."""

    policy: Literal["tree", "mlp", "sdt"] = "tree"
    """A decision tree, or a rival: a multilayer perceptron, a soft decision tree."""

    algorithm: Literal["ppo", "a2c"] = "ppo"
    """What trains it."""

    trials: int = 60
    """How many there are to be in the study, those of earlier calls included."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""

    seeds: int = 1
    """Trainings of each trial; what counts is the mean of their validation returns."""

    seed: int = 1000
    """The first of these seeds, and that of the search itself; below 1000 are those that are reported."""

    preset: str = DEFAULT
    """What trials start from, in fields that are not searched: default, paper, or the path of a .toml file."""

    storage: str | None = None
    """A journal file, or postgresql://user@host/database; runs/tune/ENV-ALGORITHM-POLICY.journal by default."""

    study: str | None = None
    """What the study is called in the storage; ENV-ALGORITHM-POLICY by default."""

    workers: int = 1
    """Processes on this machine."""

    scheduler: str | None = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    save_preset: Path | None = None
    """Write the best trial as a preset: a .toml file, for sympol train ENV --preset FILE."""

    env_kwargs: EnvKwargs = ()
    """What to make the environment with."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol tune``."""
    given = parse(Tune, "tune", words)

    from ..tune.report import require_preset_file
    from ..tune.tune import tune

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
    study, failures = tune(search, storage, name, given.trials, on_trial=_tell, **options)
    return _report(given, study, stem, failures)


def _search(given: Tune) -> Search:
    from ..results.seeds import SEARCH
    from ..tune.study import Search

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
    from ..tune.report import best_trials, save_preset, write_plots
    from ..tune.study import FAILURE, finished

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
    from ..tune.report import best_trials, counts, importances

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
