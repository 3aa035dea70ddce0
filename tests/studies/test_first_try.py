"""The study of the defaults: its environments are sound, its records are kept once, its shares are right."""

from __future__ import annotations

import json
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from studies.first_try import judge
from studies.first_try.table import of_one_library, rows, summary
from studies.first_try.tasks import Episodic, Task
from studies.first_try.worker import SETS, measure, tasks_of

OURS = [
    task
    for name in SETS
    for task in tasks_of(name).values()
    if isinstance(task.env, type) and issubclass(task.env, Episodic)
]


def episode(env: gymnasium.Env, task: Task, seed: int) -> list[Any]:
    """All that the environment says in an episode of its rule, every third action a random one."""
    env.action_space.seed(seed)
    said: list[Any] = [env.reset(seed=seed)[0]]
    while True:
        random = task.rule is None or len(said) % 3 == 0
        action = env.action_space.sample() if random else task.rule(said[-1])  # type: ignore[misc]
        assert env.action_space.contains(action), action
        answer = env.step(action)
        said += [answer[0]]
        assert env.observation_space.contains(answer[0]), answer[0]
        assert np.isfinite(answer[1])
        if answer[2] or answer[3]:
            return [*said, answer[1]]


@pytest.mark.parametrize("task", OURS, ids=lambda task: task.name)
def test_an_environment_keeps_its_promises(task: Task):
    env = task.env()  # type: ignore[operator]
    first = episode(env, task, 1)
    assert len(first) <= env.length + 2
    again = episode(task.env(), task, 1)  # type: ignore[operator]
    assert data_equivalence(tuple(first), tuple(again))
    assert not data_equivalence(tuple(first), tuple(episode(env, task, 2)))
    assert task.idle is None or env.action_space.contains(task.idle)


@pytest.mark.parametrize("name", SETS)
def test_names_and_hashes_are_of_one_task_each(name):
    tasks = tasks_of(name)
    assert len({task.digest() for task in tasks.values()}) == len(tasks)


def test_the_rule_is_better_than_random_play():
    task = tasks_of("development")["reservoir"]
    [rule], [random] = (measure(task, method, 0, {}) for method in ("rule", "random"))
    assert -5 < rule["return_mean"] < 0
    assert -300 < random["return_mean"] < -150


def record(method: str, seed: int, value: float, **more: Any) -> dict[str, Any]:
    common = {"set": "development", "env": "floor", "digest": "d", "settings": {}, "library": "one"}
    return {**common, "method": method, "seed": seed, "return_mean": value, **more}


OTHERS = [
    record("random", 0, 1.0),
    record("idle", 0, 3.0),
    record("sb3", 0, 9.0),
    record("sb3", 1, 13.0),
    record("rule", 0, 6.0),
]


def test_shares_are_of_the_best_other_method():
    [row] = rows([*OTHERS, record("tree", 0, 11.0, nodes=3), record("tree", 1, 6.0, nodes=7)])
    assert (row.best, row.shares, row.share, row.nodes) == ("sb3", [1.0, 0.5], 0.75, 5)
    assert not row.is_harmful
    assert summary([row]) == {
        "environments": 1,
        "median_share": 0.75,
        "least_share": 0.75,
        "median_of_learners": 0.75,
        "harmful": 0,
    }
    [row] = rows([*OTHERS, record("tree", 0, 2.0, nodes=3)])
    assert row.is_harmful  # better than random play, worse than doing nothing


def test_the_share_of_learners_leaves_the_rule_out():
    [row] = rows([*OTHERS, record("rule", 0, 21.0), record("tree", 0, 6.0, nodes=3)])
    assert (row.best, row.share, row.of_learners) == ("rule", 0.25, 0.5)


def test_trees_of_other_defaults_are_kept_apart():
    trees = [record("tree", 0, 1.0), record("tree", 0, 2.0, settings={"depth": 3})]
    trees += [record("tree", 0, 3.0, library="two")]
    assert len({judge.key(tree) for tree in trees}) == 3

    def chosen(*which: str) -> list[float]:
        return [r["return_mean"] for r in of_one_library(trees, *which)]

    assert chosen() == [3.0]
    assert chosen("one") == [2.0]
    assert chosen("one", "{}") == [1.0]


def test_a_record_is_measured_once(tmp_path):
    out = tmp_path / "some.jsonl"
    wanted = [*judge.due("development", ["switches"], ["rule", "idle"], [0], {})]
    assert judge.run(wanted, out) == 0
    [line] = out.read_text().splitlines()  # it has no idle action
    assert json.loads(line)["return_mean"] == 40
    written = out.stat().st_mtime_ns
    assert judge.run(wanted[:1], out) == 0
    assert out.stat().st_mtime_ns == written
