"""Polishing in turns, on whatever a road has found."""

from __future__ import annotations

from pathlib import Path

import pytest

from sympol.envs.registry import resolve
from sympol.search.evaluators import make_evaluator
from sympol.search.front.candidates import load_candidates
from sympol.search.front.config import SearchConfig
from sympol.search.front.finetune_schedule import has_numbers
from sympol.search.front.methods import run_task


def test_numbers_are_what_is_no_category():
    assert has_numbers(resolve("CartPole-v1"))
    assert has_numbers(resolve("Pendulum-v1"))
    assert not has_numbers(resolve("MiniGrid-LavaGapS5-v0"))


@pytest.mark.slow
def test_trees_from_scratch_are_polished_at_half_the_limit_and_a_quarter(tmp_path: Path):
    plan = SearchConfig("Pendulum-v1", max_nodes=15, methods=("scratch",), budget="60M steps", trainings=1)
    run_task(plan.to_dict(), str(tmp_path), "scratch", 0, 1e9, 40e6)
    found, finished = load_candidates(tmp_path / "scratch" / "0")
    assert finished
    evaluator = make_evaluator(resolve("Pendulum-v1"), 5, "validation")

    def best(road: str, nodes: int) -> float:
        trees = [one.tree for one in found if one.method.startswith(road) and one.tree.n_nodes <= nodes]
        return float(evaluator.play(trees, range(300)).returns.mean(axis=1).max())

    only_trained = [one for one in found if "polish" not in one.method]
    assert {one.method for one in found} >= {"scratch", "scratch + shrink", "scratch + polish"}
    assert max(one.cost.env_steps for one in found) > max(one.cost.env_steps for one in only_trained)
    trained = [one.tree for one in only_trained if one.tree.n_nodes <= 15]
    before = evaluator.play(trained, range(300)).returns.mean(axis=1).max()
    assert best("scratch + polish", 15) > before + 10
