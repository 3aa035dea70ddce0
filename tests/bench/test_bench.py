"""From nothing to records: what is run, what is kept, what is run again."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sympol
from sympol.bench import worker
from sympol.bench.methods import Settings, distill_options
from sympol.bench.plan import Unit, jobs_of
from sympol.bench.record import Cell, RecordError, load
from sympol.bench.run import CHANGED, Results, run, waves
from sympol.bench.worker import EPISODES
from sympol.play import play
from sympol.runs.lock import Busy, exclusive
from sympol.trees import DecisionTree

from ..tiny import quick_compiles
from .bench import METHODS_RUN, SETTINGS, bench, plans, records, tiny_bench, todo

__all__ = ["quick_compiles", "tiny_bench"]

BENCH = Path("runs") / "bench"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bench of four methods, two trainings each; do not write into it."""
    root = tmp_path_factory.mktemp("bench")
    bench(root)
    return root


@pytest.fixture
def root(finished: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    shutil.copytree(finished, tmp_path / "copy")
    return tmp_path / "copy"


def test_records_say_what_was_measured(finished):
    found = records(finished)
    assert {*found} == {*METHODS_RUN}
    for method, record in found.items():
        assert record.seeds == (0, 1)
        assert np.shape(record.returns) == np.shape(record.validation_returns) == (2, 3)
        assert (record.sampled_returns is None) == (method not in ("tree", "mlp"))
        assert (record.nodes is None) == (method == "mlp")
        assert (record.curves is None) == (method not in ("tree", "mlp"))
        assert record.total_timesteps == SETTINGS.total_timesteps
        assert record.config["training"]["policy"] == ("tree" if method == "tree" else "mlp")
        assert record.config.get("distill") == (None if record.curves else distill_options(method))
        assert record.versions["sympol"] == sympol.__version__
        assert record.commit
        assert record.date
        assert record.seconds is not None
        assert min(record.seconds) > 0
    assert found["tree"].curves is not None
    assert len(found["tree"].curves[0]["returns"]) == 8


def test_returns_are_those_of_the_policies_in_the_run_folders(finished):
    found, spec = records(finished), sympol.resolve("CartPole-v1")
    for seed in (0, 1):
        for method in ("tree", "sa-dt-5", "viper-5"):
            folder = finished / BENCH / "CartPole-v1" / f"ppo-{method}" / f"seed-{seed}"
            tree = DecisionTree.from_json((folder / "policy.json").read_text())
            assert tuple(play(tree, spec, 3, seed=EPISODES + seed).returns) == found[method].returns[seed]
            assert found[method].nodes is not None
            assert tree.n_nodes == found[method].nodes[seed]
        agent = sympol.load(finished / BENCH / "CartPole-v1" / "ppo-mlp" / f"seed-{seed}")
        assert tuple(play(agent, spec, 3, seed=EPISODES + seed).returns) == found["mlp"].returns[seed]
        before = tuple(play(agent, spec, 3, seed=EPISODES + seed, purpose="validation").returns)
        for method in ("mlp", "sa-dt-5", "viper-5"):  # of these the teacher's
            validation = found[method].validation_returns
            assert validation is not None
            assert validation[seed] == before


def test_a_run_of_a_bench_is_a_run(finished):
    folder = finished / BENCH / "CartPole-v1" / "ppo-tree" / "seed-0"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["return_mean"] == pytest.approx(np.mean(records(finished)["tree"].returns[0]))
    assert (folder / "tree.svg").is_file()


def test_what_is_finished_is_not_run_again_not_even_without_its_runs(root):
    assert todo(root) == {}
    shutil.rmtree(root / "runs")
    assert todo(root) == {}
    files = {path: path.stat().st_mtime_ns for path in (root / "results").rglob("*.json")}
    bench(root)
    assert files == {path: path.stat().st_mtime_ns for path in (root / "results").rglob("*.json")}


def test_more_trainings_are_added_to_those_there_are(root):
    assert todo(root, trainings=1) == {}
    assert todo(root, "sa-dt-5", trainings=3) == {"sa-dt-5": [2]}
    before = records(root)["sa-dt-5"]
    shutil.rmtree(root / "runs")  # as in a clean clone
    after = bench(root, "sa-dt-5", trainings=3)["sa-dt-5"]
    assert after.seeds == (0, 1, 2)
    assert after.returns[:2] == before.returns
    assert records(root)["mlp"].seeds == (0, 1)  # seed 2 was trained for its tree alone


def test_only_what_has_changed_is_run_again(root, monkeypatch):
    monkeypatch.setattr("sympol.bench.worker.train_agent", refuse)
    monkeypatch.setitem(worker.distill.__globals__["METHODS"], "sa-dt", other_sa_dt)
    assert todo(root) == {"sa-dt-5": [0, 1]}
    monkeypatch.undo()
    change(root, "mlp", "learning_rate_critic", 0.5)
    assert todo(root) == {"mlp": [0, 1]}
    assert "training.learning_rate_critic 0.5 → 0.001" in next(
        plan.status for plan in plans(root) if plan.cell.method == "mlp"
    )


def refuse(*_: Any) -> None:
    raise AssertionError("nothing is to be trained")


def other_sa_dt(teacher: Any, depth: int = 5, num_episodes: int = 24, seed: int = 0) -> Any:
    raise AssertionError("nothing is to be made")


def change(root: Path, method: str, name: str, value: Any) -> None:
    """Let a record have been made with another config."""
    record = records(root)[method]
    training = {**record.config["training"], name: value}
    dataclasses.replace(record, config={**record.config, "training": training}).save(root)


def test_a_field_that_trainings_did_not_have_yet_was_at_its_default(root):
    record = records(root)["mlp"]
    training = {name: value for name, value in record.config["training"].items() if name != "vf_coef"}
    dataclasses.replace(record, config={**record.config, "training": training}).save(root)
    assert todo(root) == {}


def test_a_small_bench_does_not_replace_a_large_one(root):
    less = Settings(SETTINGS.total_timesteps // 2, SETTINGS.episodes)
    with pytest.raises(RecordError, match=r"2 trainings of 2,048 steps.* by 2 trainings of 1,024 steps"):
        plans(root, settings=less)
    change(root, "mlp", "learning_rate_critic", 0.5)
    with pytest.raises(RecordError, match="by 1 training of"):
        plans(root, trainings=1)
    assert todo(root, "tree", trainings=1) == {}


def test_an_interrupted_bench_ends_as_one_that_was_not(finished, tmp_path, monkeypatch):
    first: list[int] = []

    def save_into(run):
        keep = keep_as_ever(run)

        def stop_later(report):
            keep(report)
            first.append(report.timestep)
            if len(first) == 3:
                raise KeyboardInterrupt

        return stop_later

    keep_as_ever = worker.save_into
    monkeypatch.setattr(worker, "save_into", save_into)
    with pytest.raises(KeyboardInterrupt):
        bench(tmp_path, "mlp", "sa-dt-5")
    assert records(tmp_path) == {}
    again = bench(tmp_path, "mlp", "sa-dt-5")
    assert first[:4] == [256, 512, 768, 1024], "it did not go on where it was"
    for method in ("mlp", "sa-dt-5"):
        one, other = again[method], records(finished)[method]
        for name in ("returns", "validation_returns", "sampled_returns", "nodes", "curves", "config"):
            assert getattr(one, name) == getattr(other, name), name


def test_units_that_are_done_are_not_done_again(root, monkeypatch):
    monkeypatch.setattr("sympol.bench.worker.train_agent", refuse)
    before = records(root)
    shutil.rmtree(root / "results")
    after = bench(root)
    for method, record in before.items():
        assert dataclasses.replace(after[method], date=record.date) == record


def test_a_damaged_result_is_made_again(root):
    file = root / BENCH / "CartPole-v1" / "ppo-tree" / "seed-0" / "bench.json"
    file.write_text(file.read_text()[:40])
    before = records(root)["tree"]
    shutil.rmtree(root / "results")
    assert bench(root, "tree")["tree"].returns == before.returns


def test_a_teacher_is_trained_only_where_there_is_none(root):
    runs = (root / BENCH).resolve()
    tree_of = Unit(Cell("CartPole-v1", "ppo", "sa-dt-5"), 0, SETTINGS, runs)
    assert waves([[tree_of]]) == [[[tree_of]]]
    assert tree_of.teacher is not None
    shutil.rmtree(tree_of.teacher.folder)
    assert waves([[tree_of]]) == [[[tree_of.teacher]], [[tree_of]]]
    assert waves([[tree_of], [tree_of.teacher]]) == [[[tree_of.teacher]], [[tree_of]]]


def test_workers_start_with_different_programs_and_cells_end_one_after_another(tmp_path):
    units = [
        Unit(Cell(env, "ppo", "tree"), seed, SETTINGS, tmp_path)
        for env in ("A-v0", "B-v0", "C-v0")
        for seed in (0, 1)
    ]
    (wave,) = waves(jobs_of(units), workers=2)
    order = [(unit.cell.environment[0], unit.seed) for (unit,) in wave]
    assert order == [("A", 0), ("B", 0), ("A", 1), ("B", 1), ("C", 0), ("C", 1)]


def test_two_benches_do_not_write_one_folder(tmp_path):
    runs = tmp_path / BENCH
    with (
        exclusive(runs, "bench", "--runs"),
        pytest.raises(Busy, match=r"another bench works in .*: process \d+ on \S+; wait"),
    ):
        run([], root=tmp_path, runs=runs)
    run([], root=tmp_path, runs=runs)


def test_a_folder_of_another_config_is_begun_anew(root):
    folder = root / BENCH / "CartPole-v1" / "ppo-mlp" / "seed-0"
    config = (folder / "config.toml").read_text()
    (folder / "config.toml").write_text(config.replace("vf_coef = 0.5", "vf_coef = 0.75"))
    (folder / "bench.json").unlink()
    before = load(records(root)["mlp"].path(root))
    shutil.rmtree(root / "results")
    assert bench(root, "mlp")["mlp"].returns == before.returns
    assert "vf_coef = 0.5" in (folder / "config.toml").read_text()


def test_what_was_made_of_another_config_than_planned_is_no_record(root):
    shutil.rmtree(root / "results")
    results = Results(root, plans(root, ("mlp",)), lambda record, path: None)
    for plan in results.plans:
        for unit in plan.units:
            result = unit.result()
            assert result is not None
            results.add(unit, {**result, "config": {**result["config"], "episodes": 4}})
    assert [failure.reason for failure in results.failures] == [CHANGED, CHANGED]
    assert records(root) == {}
