"""A search from its plan to its front: for real, on CartPole, and what happens when it is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

import sympol
import sympol.search.front.search
from sympol import DecisionTree
from sympol.cli.app import main
from sympol.distill import Teacher
from sympol.envs.registry import resolve
from sympol.play import play
from sympol.runs.lock import Busy, exclusive
from sympol.runs.metadata import RunError
from sympol.search.budget import Cost
from sympol.search.front.config import SearchConfig
from sympol.search.front.distillation import warn_of_poor_teacher
from sympol.search.front.files import load_front
from sympol.search.front.messages import (
    CANDIDATES,
    FORMER_CANDIDATES,
    Candidate,
    SavedCandidates,
    load_candidates,
    save_candidates,
)
from sympol.search.front.search import begin, budget_of, search

from ...tiny import refused

SPEC = resolve("CartPole-v1")
QUICK = SearchConfig(
    "CartPole-v1", max_nodes=5, methods=("evolve",), budget="3M steps", islands=1, eval_episodes=20
)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("front") / "quick"
    return search(QUICK, folder), folder


def test_a_front_is_found_and_each_point_is_better_than_the_smaller_ones(quick):
    front, _ = quick
    means = [point.mean for point in front.points]
    assert means == sorted(means)
    assert front.points[0].nodes == 1
    assert front.points[-1].nodes <= 5
    assert front.best().test.mean > 150  # a leaf earns nine
    assert front.cost.env_steps >= 3_000_000
    assert front.cost.selection_episodes > 0


def test_returns_of_the_test_are_those_of_its_episodes(quick):
    front, _ = quick
    for point in front.points:
        assert point.test.mean == play(point.tree, SPEC, 20, seed=1).returns.mean()


def test_it_is_kept_and_read_again(quick):
    front, folder = quick
    assert load_front(folder).points == front.points
    assert search(QUICK, folder).points == front.points  # nothing is searched again


def test_a_point_is_a_run_as_any_other(quick, capsys):
    front, folder = quick
    run = folder / "points" / f"{front.points[-1].nodes:03d}-nodes"
    assert main(["show", str(run)]) == 0
    assert "├─" in capsys.readouterr().out
    assert DecisionTree.from_json((run / "policy.json").read_text()) == front.points[-1].tree


def test_with_a_budget_in_steps_it_finds_the_same_front_again(quick, tmp_path):
    front, _ = quick
    again = search(QUICK, tmp_path / "again")
    assert [point.tree for point in again.points] == [point.tree for point in front.points]


@pytest.mark.slow
def test_all_methods_together_find_a_front(tmp_path):
    plan = SearchConfig(
        "CartPole-v1", max_nodes=15, budget="6M steps", trainings=1, teachers=1, islands=1, eval_episodes=20
    )
    front = search(plan, tmp_path / "all")
    methods = {candidate.method for candidate in front.candidates}
    # what is distilled has at most twice the limit, and is fine-tuned before it loses anything
    assert {"scratch + prune", "teacher + fine-tune + prune", "scratch + teacher + evolve"} <= methods
    assert front.best().test.mean > 450
    assert front.cost.teacher_steps > 0
    for run in ("scratch/0/run", "teacher/0/teacher"):
        assert (tmp_path / "all" / run / "summary.json").exists()


@pytest.mark.slow
def test_a_killed_search_resumes(tmp_path):
    folder = tmp_path / "front"
    plan = SearchConfig("CartPole-v1", max_nodes=5, methods=("evolve",), budget="160M steps")
    command = [sys.executable, "-m", "sympol", "pareto", "CartPole-v1", "--max-nodes", "5"]
    command += ["--methods", "evolve", "--budget", "160M steps", "--workers", "1", "--out", str(folder)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    file = folder / "evolve" / "0" / CANDIDATES
    for _ in range(1200):
        if file.exists() or process.poll() is not None:
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = load_candidates(file.parent)
    assert before.candidates
    assert not before.finished
    front = search(plan, folder)
    saved = load_candidates(file.parent)
    after = saved.candidates
    assert saved.finished
    assert after[-1].cost.env_steps >= plan.steps * plan.share("evolve") / plan.islands
    assert after[-1].cost.env_steps < 1.5 * plan.steps * plan.share("evolve") / plan.islands
    assert front.best().test.mean > 400


def test_a_method_without_its_library_is_refused_before_anything_is_done(tmp_path, monkeypatch):
    monkeypatch.setattr(sympol.search.front.search, "LIBRARIES", {"pycma": "no_such_module"})
    with pytest.raises(RunError, match=r"needs pycma, not installed here: pip install 'sympol\[bench\]'"):
        begin(SearchConfig("CartPole-v1"), tmp_path / "front")
    assert not (tmp_path / "front").exists()
    begin(SearchConfig("CartPole-v1", methods=("scratch", "evolve")), tmp_path / "front")


def test_another_plan_or_another_folder_is_refused(quick, tmp_path):
    _, folder = quick
    with pytest.raises(RunError, match=r"holds a search with max_nodes 5, not 7.*--overwrite"):
        begin(
            SearchConfig(
                "CartPole-v1",
                max_nodes=7,
                methods=("evolve",),
                budget="3M steps",
                islands=1,
                eval_episodes=20,
            ),
            folder,
        )
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RunError, match="is no search"):
        begin(QUICK, tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_two_searches_do_not_share_a_folder(tmp_path):
    begin(QUICK, tmp_path / "front")
    with (
        exclusive(tmp_path / "front", "search", "--out"),
        pytest.raises(Busy, match=r"another search works in .*choose another --out"),
    ):
        search(QUICK, tmp_path / "front")


def single_leaf() -> DecisionTree:
    none = np.array([], int), np.array([]), np.array([[1.0, 0.0]])
    return DecisionTree.from_complete(*none, actions=SPEC.actions, **SPEC.features.metadata())


def test_candidates_are_saved_to_the_bit(tmp_path):
    tree = DecisionTree.from_complete(
        np.array([2]), np.array([0.1]), np.array([[1.0, 0.0], [0.0, 1.0]]),
        actions=SPEC.actions, **SPEC.features.metadata(),
    )  # fmt: skip
    found = (Candidate(tree, "scratch", Cost(3, 4, 5, 6.5)),)
    save_candidates(tmp_path, found, finished=False)
    assert load_candidates(tmp_path) == SavedCandidates(False, found)
    assert load_candidates(tmp_path / "nowhere") == SavedCandidates(False, ())
    content = json.loads((tmp_path / CANDIDATES).read_text())
    del content["candidates"][0]["method"]
    (tmp_path / CANDIDATES).write_text(json.dumps(content))
    with pytest.raises(
        ValueError, match=r"cannot be read.*Candidate has missing fields method.*search again"
    ):
        load_candidates(tmp_path)


def test_candidates_of_an_earlier_version_are_read_under_present_names(tmp_path):
    tree = single_leaf()
    row = {
        "road": "lookup + shrink",
        "spent": {"env_steps": 3, "teacher_steps": 0, "selection_episodes": 0, "seconds": 1.5},
        "tree": json.loads(tree.to_json()),
    }
    (tmp_path / FORMER_CANDIDATES).write_text(json.dumps({"finished": True, "found": [row]}))
    expected = Candidate(tree, "tabular + prune", Cost(3, seconds=1.5))
    assert load_candidates(tmp_path) == SavedCandidates(True, (expected,))


def test_a_teacher_that_chance_beats_is_named_with_both_numbers():
    poor = Teacher.from_callable(lambda x: 1, SPEC)
    with pytest.warns(UserWarning, match=r"earns 9\.\d, less than a random policy does, \d\d\.\d"):
        warn_of_poor_teacher(poor)
    good = Teacher.from_callable(lambda x: int(x[2] + x[3] > 0), SPEC)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_poor_teacher(good)


@pytest.mark.slow
def test_a_poor_teacher_is_warned_of_where_the_search_was_started(tmp_path):
    lazy = sympol.PPO("mlp", "CartPole-v1", total_timesteps=8192, learning_rate_actor=1e-12)
    lazy.learn(progress_bar=False).save(tmp_path / "lazy")
    plan = SearchConfig(
        "CartPole-v1",
        max_nodes=3,
        methods=("teacher",),
        budget="2M steps",
        teachers=1,
        teacher=str(tmp_path / "lazy"),
    )
    with pytest.warns(UserWarning, match=r"teacher: the teacher earns .*, less than a random policy does"):
        search(plan, tmp_path / "front", workers=2)


def test_the_time_of_a_method_before_an_interruption_counts_once():
    plan = SearchConfig("CartPole-v1", methods=("scratch", "evolve"), budget="100s")
    whole = budget_of(plan, "evolve", 30.0).seconds  # scratch took 30
    assert whole == pytest.approx(60)  # ten are for choosing
    assert budget_of(plan, "scratch", 0.0).seconds == pytest.approx(100 * plan.share("scratch"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--max-nodes", "8"], "max_nodes must be odd"),
        (["--budget", "soon"], "budget must be a time"),
        (["--workers", "-1"], "--workers must be at least 1"),
        (["--teacher", "nowhere"], "there is no teacher 'nowhere'"),
    ],
)
def test_bad_input_is_one_line(arguments, words, tmp_path, capsys):
    assert words in refused(capsys, "pareto", "CartPole-v1", "--out", tmp_path / "front", *arguments)
    assert not (tmp_path / "front").exists()


@pytest.mark.slow
def test_the_command_shows_the_front(tmp_path):
    command = [
        sys.executable,
        "-m",
        "sympol.cli.app",
        "pareto",
        "CartPole-v1",
        "--max-nodes",
        "3",
        "--roads",  # the former name of --methods
        "evolve",
    ]
    command += [
        "--budget",
        "500k steps",
        "--islands",
        "1",
        "--eval-episodes",
        "5",
        "--out",
        str(tmp_path / "f"),
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "COLUMNS": "80"}
    )
    assert done.returncode == 0, done.stderr
    assert "validation ± 95 %" in done.stdout
    assert f"sympol show {tmp_path}" in done.stdout
    assert (tmp_path / "f" / "front.svg").stat().st_size > 1000
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["environment"] == "CartPole-v1"
