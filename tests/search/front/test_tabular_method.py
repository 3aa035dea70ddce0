"""The road of known worlds: trees that do what the table says, and smaller ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from sympol.envs.registry import resolve
from sympol.search.budget import Budget
from sympol.search.evaluators import make_evaluator
from sympol.search.front.candidates import load_candidates
from sympol.search.front.config import SearchConfig
from sympol.search.front.context import TaskContext
from sympol.search.front.methods import is_known, run_tabular


def test_a_tree_takes_the_shortest_way_and_smaller_ones_are_kept(tmp_path: Path):
    name = "MiniGrid-DistShift1-v0"
    spec = resolve(name)
    run_tabular(
        TaskContext(SearchConfig(name), spec, tmp_path, 0, tmp_path / "teacher" / "0", Budget(steps=2e8))
    )
    found, finished = load_candidates(tmp_path / "teacher" / "0")
    assert finished
    returns = make_evaluator(spec, 7).play([one.tree for one in found], range(4)).returns.mean(axis=1)
    assert returns.max() == pytest.approx(1 - 0.9 * 13 / 252)  # 13 steps are the fewest
    best = found[int(returns.argmax())]
    assert best.method.startswith("lookup")
    assert best.tree.n_nodes < 20
    assert len({one.tree.n_nodes for one in found}) > 2
    assert all(one.cost.env_steps > 0 for one in found)


def test_only_small_worlds_are_known():
    assert is_known(resolve("MiniGrid-LavaGapS5-v0"))
    assert not is_known(resolve("CartPole-v1"))
    assert not is_known(resolve("MiniGrid-FourRooms-v0"))
    assert not is_known(resolve("FrozenLake-v1"))
