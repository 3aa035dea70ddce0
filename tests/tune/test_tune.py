"""Searches: what is run, what is not run again, what is pruned, what fails, and that seeds decide all of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.trial import TrialState

from sympol.agents import agent_of
from sympol.envs.errors import EnvironmentFailure
from sympol.tune import tune as module
from sympol.tune.report import best_trials, counts, importances, write_plots
from sympol.tune.search_spaces import Range
from sympol.tune.storage import open_storage
from sympol.tune.study import OtherStudy, Search, finished, open_study
from sympol.tune.tune import STARTUP, Outcome, tune, validation_return

from ..tiny import quick_compiles
from .postgres import Server, server
from .tuning import EVALS, SPACE, STEPS, Scripted, as_others_compute, search

__all__ = ["as_others_compute", "quick_compiles", "server"]

LONGER = {"total_timesteps": 2 * STEPS}
GOOD = [*np.linspace(10, 200, EVALS)]


def run(folder: Path, trials: int, **options: Any) -> optuna.Study:
    of = {key: options.pop(key) for key in ("seeds", "space") if key in options}
    study, failures = tune(
        search(folder, **of), str(folder / "s.journal"), "s", trials, progress=False, **options
    )
    assert failures == []
    return study


def found(study: optuna.Study) -> list[tuple[dict[str, Any], float | None]]:
    return [(trial.params, trial.value) for trial in study.trials]


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Any:
    def use(*curves: Any) -> Scripted:
        agents = Scripted(*curves)
        monkeypatch.setattr(module, "agent_of", agents)
        return agents

    return use


def test_a_search_that_was_stopped_ends_as_one_that_was_not(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    told: list[Outcome] = []
    whole = run(tmp_path / "a", 4, on_trial=told.append)
    run(tmp_path / "b", 1)
    parts = run(tmp_path / "b", 4)
    assert found(whole) == found(parts)
    assert [outcome.number for outcome in told] == [0, 1, 2, 3]
    assert len({params["learning_rate_leaf_values"] for params, _ in found(whole)}) == 4
    values = [value for _, value in found(whole)]
    assert len({*values}) > 1
    assert best_trials(whole)[0].value == max(values, key=lambda value: value or 0)

    told.clear()
    assert found(run(tmp_path / "a", 3, on_trial=told.append)) == found(whole)
    assert told == []


@pytest.mark.slow
def test_two_workers_share_a_study(tmp_path):
    study = run(tmp_path, 4, workers=2)
    assert counts(study) == {"complete": 4, "pruned": 0, "fail": 0}
    assert len({params["learning_rate_leaf_values"] for params, _ in found(study)}) == 4
    of, trial = search(tmp_path), study.trials[0]
    alone = agent_of(of.spec(), of.config_of(trial.params), 1000).learn(progress_bar=False)
    assert validation_return(alone) == trial.value


@pytest.mark.slow
def test_two_workers_share_a_study_in_postgresql(server: Server, tmp_path):
    study, failures = tune(search(tmp_path), server.url(), "tiny", 3, workers=2, progress=False)
    assert failures == []
    assert counts(study)["complete"] == 3
    again, _ = tune(search(tmp_path), server.url(), "tiny", 3, progress=False)
    assert found(again) == found(study)


def test_hopeless_trials_are_pruned_after_a_third_of_the_training(tmp_path, scripted):
    hopeless = [9.0] * EVALS
    late = [9.0] * (EVALS // 3) + [300.0] * (EVALS - EVALS // 3)
    scripted(*[GOOD] * STARTUP, hopeless, late, GOOD)
    study = run(tmp_path, STARTUP + 3)
    assert counts(study) == {"complete": STARTUP + 2, "pruned": 1, "fail": 0}
    (pruned,) = [trial for trial in study.trials if trial.state == TrialState.PRUNED]
    assert pruned.number == STARTUP
    assert [*pruned.intermediate_values] == [*range(1, EVALS // 3 + 2)]
    assert best_trials(study)[0].number == STARTUP + 1


def test_nothing_is_pruned_before_enough_is_known(tmp_path, scripted):
    scripted(*[GOOD] * (STARTUP - 1), [9.0] * EVALS)
    assert counts(run(tmp_path, STARTUP))["complete"] == STARTUP


def test_a_training_that_comes_to_nan_is_a_failed_trial_and_no_more(tmp_path, scripted):
    scripted(GOOD, EnvironmentFailure("the training came to NaN"), GOOD)
    told: list[Outcome] = []
    study = run(tmp_path, 4, on_trial=told.append)
    assert counts(study) == {"complete": 3, "pruned": 0, "fail": 1}
    assert told[1] == Outcome(1, "fail", None, "the training came to NaN", best=200.0)
    agents = scripted(GOOD)
    run(tmp_path, 4)
    assert agents.seeds == []


def test_what_fails_otherwise_is_told_and_run_again(tmp_path, scripted):
    scripted(GOOD, MemoryError("no memory left"), GOOD)
    study, failures = tune(search(tmp_path), str(tmp_path / "s.journal"), "s", 3, progress=False)
    assert [failure.reason for failure in failures] == ["MemoryError: no memory left"]
    assert len(finished(study)) == 2
    agents = scripted(GOOD)
    assert counts(run(tmp_path, 3))["complete"] == 3
    assert len(agents.seeds) == 1


def test_a_trial_whose_worker_was_killed_is_run_again(tmp_path, scripted):
    scripted(GOOD)
    run(tmp_path, 1).ask()
    study = run(tmp_path, 3)
    assert counts(study)["complete"] == 3
    assert [trial.state for trial in study.trials].count(TrialState.RUNNING) == 1


def test_a_trial_trains_once_for_each_seed_and_counts_their_mean(tmp_path, scripted):
    agents = scripted([10.0] * EVALS, [30.0] * EVALS)
    study = run(tmp_path, 1, seeds=(1000, 1001))
    assert agents.seeds == [1000, 1001]
    assert agents.configs[0] == agents.configs[1]
    (trial,) = study.trials
    assert trial.value == 20.0
    assert [*trial.intermediate_values] == [*range(1, 2 * EVALS + 1)]
    assert trial.intermediate_values[EVALS + 1] == 20.0
    assert trial.user_attrs["returns"] == [10.0, 30.0]


def test_another_seed_is_another_search(tmp_path, scripted):
    scripted(GOOD)
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one, two = run(tmp_path / "a", 2), run(tmp_path / "b", 2, seeds=(1001,))
    assert [params for params, _ in found(one)] != [params for params, _ in found(two)]


@pytest.mark.parametrize("seed", [0, 999])
def test_a_reported_seed_chooses_nothing(tmp_path, seed):
    with pytest.raises(ValueError, match=f"of a search must be .* from 1000 .* got {seed}"):
        search(tmp_path, seeds=(1000, seed))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            {"total_timesteps": 2 * STEPS},
            "created with total_timesteps 2048, not 4096; resume .*another --study",
        ),
        ({"seeds": (1000, 1001)}, r"created with seeds \[1000\], not \[1000, 1001\]"),
        (
            {"policy": "mlp", "preset_name": "default", **LONGER},
            "created with policy tree, not mlp; .* more that differ",
        ),
        ({"algorithm": "a2c", "preset_name": "default"}, "created with algorithm ppo, not a2c"),
        ({"space": {**SPACE, "vf_coef": Range(0.1, 1.0)}}, "vf_coef 0.5, not None; another search space"),
        ({"space": {**SPACE, "gamma": (0.9, 0.95)}}, "created with another search space"),
    ],
)
def test_a_study_of_another_search_is_refused(tmp_path, scripted, options, words):
    agents = scripted(GOOD)
    run(tmp_path, 1)
    if options.get("policy") == "mlp":
        options = {**options, "space": {"gamma": (0.9, 0.99)}}
    elif "algorithm" in options:
        options = {**options, "space": SPACE}
    with pytest.raises(OtherStudy, match=words):
        tune(search(tmp_path, **options), str(tmp_path / "s.journal"), "s", 2, progress=False)
    assert len(agents.seeds) == 1


def test_a_study_of_another_environment_is_refused(tmp_path, scripted):
    scripted(GOOD)
    run(tmp_path, 1)
    with pytest.raises(OtherStudy, match="created with env CartPole-v1, not Acrobot-v1"):
        open_study(str(tmp_path / "s.journal"), "s", Search.of("Acrobot-v1"))


def test_a_study_that_somebody_else_began_is_refused(tmp_path):
    path = str(tmp_path / "s.journal")
    optuna.create_study(study_name="s", storage=open_storage(path)).ask()
    with pytest.raises(OtherStudy, match="'s' was not created by sympol tune"):
        open_study(path, "s", search(tmp_path))


def test_a_space_with_configs_that_cannot_be_trained_is_refused_before_any_is(tmp_path):
    with pytest.raises(ValueError, match="total_timesteps must cover one rollout of 64 steps × 64"):
        search(tmp_path, space={"num_envs": Range(4, 64), "num_steps": (16, 512)})


def test_plots_and_importances(tmp_path, scripted):
    scripted(*([*np.linspace(1, top, EVALS)] for top in range(10, 10 + STARTUP)), [0.0] * EVALS)
    study = run(tmp_path, STARTUP + 1)
    assert counts(study)["pruned"] == 1
    shares = importances(study)
    assert {*shares} == {*SPACE}
    assert sum(shares.values()) == pytest.approx(1)
    history, importance = write_plots(study, tmp_path / "plots" / "s")
    assert (history.name, importance.name) == ("s-history.svg", "s-importance.svg")
    written = history.read_bytes()
    assert b"<svg" in written
    write_plots(study, tmp_path / "plots" / "s")
    assert history.read_bytes() == written


def test_of_few_trials_nothing_is_said_to_matter(tmp_path, scripted):
    scripted(GOOD, [1.0] * EVALS)
    study = run(tmp_path, 2)
    assert importances(study) == {}
    assert [path.name for path in write_plots(study, tmp_path / "s")] == ["s-history.svg"]
