"""Hyperparameter search: the trials of a study, each a task, in this process, in several, or on a cluster.

A task is one trial and needs only the storage and the name of the study. The sampler of the k-th task is seeded by k,
so that a search that was stopped and resumed ends like one that was not.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..agents import Agent, Report, agent_of
from ..algorithms.config import Config
from ..envs.errors import EnvironmentFailure
from ..parallel import Failure, Task, TasksFailed, run_tasks
from ..results.seeds import require_search_seed
from .search_spaces import suggest
from .study import FAILURE, Search, finished, open_study, quiet, search_of

if TYPE_CHECKING:
    from optuna import Study, Trial
    from optuna.pruners import BasePruner
    from optuna.samplers import BaseSampler
    from optuna.trial import FrozenTrial

STARTUP = 10
"""The number of trials with random parameters, and of completed trials before any is pruned."""


@dataclass(frozen=True)
class Outcome:
    """The end of a trial."""

    number: int
    state: str
    """``"complete"``, ``"pruned"`` or ``"fail"``."""
    value: float | None
    failure: str | None
    best: float | None = None
    """The value of the best trial of the study so far."""


def tune(
    search: Search,
    storage: str,
    name: str,
    trials: int,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    progress: bool = True,
    on_trial: Callable[[Outcome], None] = lambda outcome: None,
) -> tuple[Study, list[Failure]]:
    """Run the trials that a study lacks.

    Args:
        search: The search.
        storage: A file or a PostgreSQL address, see `open_storage`.
        name: The name of the study.
        trials: The number of trials that the study will have.
        workers: Processes on this machine.
        scheduler: The address of a Dask scheduler, in place of ``workers``.
        progress: Whether to draw a line of progress.
        on_trial: Called with each trial that ends.

    Returns:
        The study, and the tasks that failed in another way than a trial may.

    Raises:
        OtherStudy: The storage has another search under this name.
        StorageError, SchedulerError, ValueError, ImportError: See `open_storage` and `run_tasks`.
    """
    if trials < 1:
        raise ValueError(f"trials must be at least 1, got {trials}")
    if "://" not in storage:
        storage = os.path.abspath(storage)  # a worker may be in another folder
    study = open_study(storage, name, search)
    shared = {"storage": storage, "name": name, "trials": trials}
    shared["parallel"] = workers > 1 or scheduler is not None
    tasks = [
        Task(f"trial {index}", "sympol.tune.tune:run_trial", {"index": index, **shared})
        for index in range(len(finished(study)), trials)
    ]

    def report(task: Task, result: dict[str, Any] | None) -> None:
        if result is not None:
            on_trial(Outcome(**result))

    try:
        run_tasks(tasks, workers=workers, scheduler=scheduler, on_done=report, progress=progress)
    except TasksFailed as failed:
        return study, failed.failures
    return study, []


def run_trial(storage: str, name: str, trials: int, index: int, parallel: bool) -> dict[str, Any] | None:
    """Run one trial of a study unless it has enough; this is the task of `tune`.

    Args:
        storage: The storage of the study.
        name: The name of the study.
        trials: The number of trials that the study needs.
        index: The index of this task, which seeds the sampler.
        parallel: Whether other workers run trials of the study.

    Returns:
        The fields of an `Outcome`, or None if there were enough trials.
    """
    study = open_study(storage, name)
    search = search_of(study)
    if len(finished(study)) >= trials:
        return None
    with quiet():
        study.sampler, study.pruner = _sampler(search, index, parallel), _pruner(search)
        ran: list[FrozenTrial] = []
        study.optimize(
            lambda trial: objective(trial, search),
            n_trials=1,
            catch=(EnvironmentFailure,),
            callbacks=[lambda study, trial: ran.append(trial)],
        )
    (trial,) = ran
    best = max(
        (t.value for t in finished(study) if t.state.name == "COMPLETE" and t.value is not None), default=None
    )
    return vars(
        Outcome(trial.number, trial.state.name.lower(), trial.value, trial.user_attrs.get(FAILURE), best)
    )


def objective(trial: Trial, search: Search) -> float:
    """Train once for each seed with the parameters of a trial, and return the mean validation return.

    Each validation is reported to the study, which may prune the trial. With several seeds, the mean of the finished
    trainings and the current one is reported.

    Args:
        trial: The trial.
        search: The search.

    Raises:
        optuna.TrialPruned: The trial is too poor to go on.
        EnvironmentFailure: A training reached NaN.
    """
    config, spec = search.config_of(suggest(trial, search.space)), search.spec()
    step = _steps(trial, last=config.num_evals * len(search.seeds))
    returns: list[float] = []
    for seed in search.seeds:
        agent = agent_of(spec, config, require_search_seed(seed))

        def on_validation(report: Report) -> None:
            now = report.metrics["eval/mean_reward"]
            step(float(np.mean([*returns, now])))

        try:
            agent.learn(callback=on_validation, progress_bar=False)
        except EnvironmentFailure as failure:
            trial.set_user_attr(FAILURE, str(failure))
            raise
        returns.append(validation_return(agent))
    trial.set_user_attr("returns", returns)
    return float(np.mean(returns))


def _steps(trial: Trial, last: int) -> Callable[[float], None]:
    """Return a function that reports a validation; each but the last may prune the trial."""
    from optuna import TrialPruned

    count = 0

    def step(value: float) -> None:
        nonlocal count
        count += 1
        trial.report(value, count)
        if count < last and trial.should_prune():
            raise TrialPruned(f"at validation {count} of {last}")

    return step


def validation_return(agent: Agent) -> float:
    """Return the validation return of the policy that a training returns: the best (``select_best``) or the last."""
    assert agent.state is not None
    validation = agent.state.validation
    return float(validation.best_return if agent.config.select_best else validation.last_return)


def _sampler(search: Search, index: int, parallel: bool) -> BaseSampler:
    from optuna.samplers import TPESampler

    seed = int(np.random.SeedSequence([search.seeds[0], index]).generate_state(1)[0])
    # with other workers, running trials count as bad, so that nobody tries the same. In one process there are none: a
    # trial that seems to run was killed
    return TPESampler(seed=seed, n_startup_trials=STARTUP, constant_liar=parallel)


def _pruner(search: Search) -> BasePruner:
    """Return a median pruner.

    Hyperband would sample for each of its brackets alone, and with 60 trials none of them would learn enough. Its first
    cut also comes early, when a dynamic rollout has hardly begun to grow. The median pruner ends a trial whose best
    validation so far is below the median of completed trials at that point, but not in the first third of the training,
    where rewards that are hard to find are found by luck.
    """
    from optuna.pruners import MedianPruner

    warmup = search.config.get("num_evals", Config.num_evals) // 3 + 1  # the first that may be pruned
    return MedianPruner(n_startup_trials=STARTUP, n_warmup_steps=warmup, n_min_trials=5)
