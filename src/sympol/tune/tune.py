"""A search for hyperparameters: trials of one study, each a task, in this process, in several or on a cluster.

A task is one trial and needs the study's storage and name alone. So there are exactly as many trials as were asked for,
and a search that was stopped goes on as if it had not been: the sampler of the k-th finished trial is seeded by k.
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
from .search_spaces import drawn
from .study import FAILURE, Search, finished, open_study, quiet, search_of

if TYPE_CHECKING:
    from optuna import Study, Trial
    from optuna.pruners import BasePruner
    from optuna.samplers import BaseSampler
    from optuna.trial import FrozenTrial

STARTUP = 10
"""So many trials are drawn at random, and as many completed before any is pruned."""


@dataclass(frozen=True)
class Outcome:
    """What came of a trial."""

    number: int
    state: str
    """``"complete"``, ``"pruned"`` or ``"fail"``."""
    value: float | None
    failure: str | None
    best: float | None = None
    """Value of the best trial of the study by then."""


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
    """Run the trials that a study lacks; return it, with the tasks that failed otherwise than a trial may.

    Raises:
        OtherStudy: the storage has another search under that name.
        StorageError, SchedulerError, ValueError, ImportError: see `open_storage` and `run_tasks`.
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

    def told(task: Task, result: dict[str, Any] | None) -> None:
        if result is not None:
            on_trial(Outcome(**result))

    try:
        run_tasks(tasks, workers=workers, scheduler=scheduler, on_done=told, progress=progress)
    except TasksFailed as failed:
        return study, failed.failures
    return study, []


def run_trial(storage: str, name: str, trials: int, index: int, parallel: bool) -> dict[str, Any] | None:
    """Run one trial of a study (`tune`), unless others have done enough of them; return an `Outcome`'s fields."""
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
    """Train with what the trial draws, once for each seed; the mean validation return.

    Each validation is told to the study, which may prune the trial: with several seeds as the mean of those that are
    done and the one at work.

    Raises:
        optuna.TrialPruned: it is hopeless.
        EnvironmentFailure: a training came to NaN.
    """
    config, spec = search.config_of(drawn(trial, search.space)), search.spec()
    step = _steps(trial, last=config.num_evals * len(search.seeds))
    returns: list[float] = []
    for seed in search.seeds:
        agent = agent_of(spec, config, require_search_seed(seed))

        def watch(report: Report) -> None:
            now = report.metrics["eval/mean_reward"]
            step(float(np.mean([*returns, now])))

        try:
            agent.learn(callback=watch, progress_bar=False)
        except EnvironmentFailure as failure:
            trial.set_user_attr(FAILURE, str(failure))
            raise
        returns.append(validation_return(agent))
    trial.set_user_attr("returns", returns)
    return float(np.mean(returns))


def _steps(trial: Trial, last: int) -> Callable[[float], None]:
    """Count validations; all but the last may end the trial, which at the last has earned its value."""
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
    """Of the policy that a training returns: the best validated (``select_best``) or the last."""
    assert agent.state is not None
    validation = agent.state.validation
    return float(validation.best_return if agent.config.select_best else validation.last_return)


def _sampler(search: Search, index: int, parallel: bool) -> BaseSampler:
    from optuna.samplers import TPESampler

    seed = int(np.random.SeedSequence([search.seeds[0], index]).generate_state(1)[0])
    # where others are at work, what they try counts as bad, so that nobody tries the same. In one process nobody is:
    # a trial that looks like it was killed
    return TPESampler(seed=seed, n_startup_trials=STARTUP, constant_liar=parallel)


def _pruner(search: Search) -> BasePruner:
    """Median, not Hyperband.

    Hyperband samples for each of its brackets by itself, of which with 60 trials none gets to know enough, and its
    first cut comes early, when a dynamic rollout has hardly begun to grow. A trial is pruned if its best validation so
    far is below the median of what completed trials had at that point; not in the first third of the training, where
    rewards that are hard to find are found by luck.
    """
    from optuna.pruners import MedianPruner

    warmup = search.config.get("num_evals", Config.num_evals) // 3 + 1  # the first that may be pruned
    return MedianPruner(n_startup_trials=STARTUP, n_warmup_steps=warmup, n_min_trials=5)
