"""Fine-tuning in turns, on the candidates of any method."""

from __future__ import annotations

from pathlib import Path

import pytest

from sympol.envs.registry import resolve
from sympol.results.records import to_fields
from sympol.search.budget import Budget
from sympol.search.evaluators import make_evaluator
from sympol.search.front.config import SearchConfig
from sympol.search.front.messages import TaskRequest, load_candidates
from sympol.search.front.methods import run_task
from sympol.search.front.task import has_numbers


def test_numbers_are_what_is_no_category():
    assert has_numbers(resolve("CartPole-v1"))
    assert has_numbers(resolve("Pendulum-v1"))
    assert not has_numbers(resolve("MiniGrid-LavaGapS5-v0"))


@pytest.mark.slow
def test_trees_from_scratch_are_fine_tuned_at_half_the_limit_and_a_quarter(tmp_path: Path):
    plan = SearchConfig("Pendulum-v1", max_nodes=15, methods=("scratch",), budget="60M steps", trainings=1)
    run_task(to_fields(TaskRequest(plan, tmp_path, "scratch", 0, Budget(40e6, 1e9))))
    saved = load_candidates(tmp_path / "scratch" / "0")
    found = saved.candidates
    assert saved.finished
    evaluator = make_evaluator(resolve("Pendulum-v1"), 5, "validation")

    def best(method: str, nodes: int) -> float:
        trees = [one.tree for one in found if one.method.startswith(method) and one.tree.n_nodes <= nodes]
        return float(evaluator.play(trees, range(300)).returns.mean(axis=1).max())

    only_trained = [one for one in found if "fine-tune" not in one.method]
    assert {one.method for one in found} >= {"scratch", "scratch + prune", "scratch + fine-tune"}
    assert max(one.cost.env_steps for one in found) > max(one.cost.env_steps for one in only_trained)
    trained = [one.tree for one in only_trained if one.tree.n_nodes <= 15]
    before = evaluator.play(trained, range(300)).returns.mean(axis=1).max()
    assert best("scratch + fine-tune", 15) > before + 10
