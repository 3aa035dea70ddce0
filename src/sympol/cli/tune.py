"""``sympol tune``: hyperparameter search."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.markup import escape
from rich.table import Table as Shown

from ..algorithms.presets import DEFAULT
from ..runs.formatting import decimals
from ..runs.metadata import file_name
from ..threads import use_one_thread
from .arguments import EnvKwargs, OptionalPath, OptionalText, Text, Workers, env_kwargs, parse
from .console import err, out, print_error

if TYPE_CHECKING:
    from optuna import Study

    from ..parallel import Failure
    from ..tune.study import Search
    from ..tune.tune import Outcome

_SHOWN = 3
"""The number of best trials that are shown beside each other."""

MOST_SEEDS = 1000
"""The largest number of trainings of one trial."""


@dataclass
class Trials:
    """Set the number of trials and the trainings of each."""

    trials: int = 60
    """Number of trials in the study, those of earlier calls included."""

    total_timesteps: int = 1_000_000
    """Environment steps of each training."""

    seeds: int = 1
    """Number of trainings of each trial; its value is the mean of their validation returns."""

    seed: int = 1000
    """The first seed of the trainings, and the seed of the search itself. Seeds below 1000 are for trainings that are
    reported."""

    preset: str = DEFAULT
    """Source of the hyperparameters that are not searched: default, paper, or the path of a .toml file."""


@dataclass
class Storage:
    """Choose where the study is kept."""

    storage: OptionalText = None
    """A journal file, or postgresql://user@host/database; by default runs/tune/ENV-ALGORITHM-POLICY.journal."""

    study: OptionalText = None
    """The study's name in the storage; by default ENV-ALGORITHM-POLICY."""


@dataclass
class Tune:
    """Search hyperparameters for an environment and a policy, by validation returns, in the paper's search spaces.

    Trials are kept in a study. After an interruption the same command resumes, and a larger --trials adds to the study.
    A median pruner ends poor trials early.

    Save the best hyperparameters as a preset: sympol tune CartPole-v1 --save-preset best.toml

    Train with them: sympol train CartPole-v1 --preset best.toml
    """

    env: Annotated[Text, tyro.conf.arg(metavar="ENV")]
    """Gymnasium id, such as CartPole-v1, or file.py:Name or module:Name."""

    policy: Literal["tree", "mlp", "sdt"] = "tree"
    """The actor: a decision tree, or a baseline: a multilayer perceptron or a soft decision tree."""

    algorithm: Literal["ppo", "a2c"] = "ppo"
    """The algorithm that trains it."""

    env_kwargs: EnvKwargs = ()
    """Arguments of the environment, such as view_size=5 or continuous=true."""

    save_preset: OptionalPath = None
    """Write the best trial as a preset into this .toml file, for sympol train ENV --preset FILE."""

    trials: Trials = field(default_factory=Trials)
    processes: Workers = field(default_factory=Workers)
    storage: Storage = field(default_factory=Storage)


def run(words: Sequence[str]) -> int:
    """Run ``sympol tune``.

    Args:
        words: The words after the command's name.

    Returns:
        The exit status: 1 if no trial was completed or a worker failed, else 0.
    """
    given = parse(Tune, "tune", words)

    from ..tune.report import require_preset_file
    from ..tune.tune import tune

    search = _search(given)
    if given.save_preset is not None:
        require_preset_file(given.save_preset)  # an error now rather than after sixty trials
    use_one_thread()
    name = given.storage.study or f"{search.env}-{search.algorithm}-{search.policy}"
    stem = Path("runs", "tune", file_name(name))
    storage = given.storage.storage or str(stem.with_name(f"{stem.name}.journal"))
    if "://" not in storage:
        stem = (
            Path(storage).with_suffix("") if given.storage.study is None else Path(storage).parent / stem.name
        )
    err.print(_plan(given, search, name, storage), markup=False)
    options: dict[str, Any] = {"workers": given.processes.workers, "scheduler": given.processes.scheduler}
    study, failures = tune(search, storage, name, given.trials.trials, on_trial=_print_trial, **options)
    return _report(given, study, stem, failures)


def _search(given: Tune) -> Search:
    from ..results.seeds import SEARCH
    from ..tune.study import Search

    numbers = {**vars(given.trials), "workers": given.processes.workers}
    for name in ("trials", "total_timesteps", "seeds", "workers"):
        if numbers[name] < 1:
            raise ValueError(f"--{name.replace('_', '-')} must be at least 1, got {numbers[name]}")
    if given.trials.seeds > MOST_SEEDS:
        raise ValueError(
            f"--seeds must be at most {MOST_SEEDS:,}, got {given.trials.seeds}: each trial trains with all of them"
        )
    if given.trials.seed not in SEARCH:
        raise ValueError(
            f"--seed must be at least {SEARCH.start}, got {given.trials.seed}: smaller seeds are for trainings that "
            "are reported, which choose nothing"
        )
    return Search.of(
        given.env,
        given.policy,
        given.algorithm,
        total_timesteps=given.trials.total_timesteps,
        seeds=range(given.trials.seed, given.trials.seed + given.trials.seeds),
        preset_name=given.trials.preset,
        env_kwargs=env_kwargs(given.env_kwargs),
    )


def _plan(given: Tune, search: Search, name: str, storage: str) -> str:
    what = {"tree": "a tree", "mlp": "an MLP", "sdt": "a soft tree"}[search.policy]
    seeds = f"seed {search.seeds[0]}" + (f" to {search.seeds[-1]}" if len(search.seeds) > 1 else "")
    where = "PostgreSQL" if "://" in storage else storage  # an address may hold a password
    return (
        f"{given.trials.trials} trials of {what} by {search.algorithm.upper()} on {search.env}, "
        f"{given.trials.total_timesteps:,} steps, {seeds}; study {name} in {where}"
    )


def _print_trial(outcome: Outcome) -> None:
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
            f"--{name}={getattr(given, name)}"
            for name in ("algorithm", "policy")
            if getattr(given, name) != getattr(Tune, name)
        ]
        words += ["--env-kwargs", *given.env_kwargs] if given.env_kwargs else []
        err.print(f"the best is in {given.save_preset}; train with it: {shlex.join(words)}", markup=False)
    return 1 if failures else 0


def _table(study: Study) -> Shown:
    """Return a table with a column for each of the best trials, and the importance of each hyperparameter."""
    from ..tune.report import best_trials, counts, importances

    best, shares = best_trials(study)[:_SHOWN], importances(study)
    there = counts(study)
    shown = Shown(
        title=escape(
            f"{study.study_name}: {there['complete']} completed, {there['pruned']} pruned, {there['fail']} failed"
        ),
        caption="importance: share in what distinguishes the best trials" if shares else None,
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
