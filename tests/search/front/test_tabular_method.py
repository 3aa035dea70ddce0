"""The method of environments whose states are listed: trees that act as the table says, and smaller ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from sympol.envs.registry import resolve
from sympol.search.budget import Budget
from sympol.search.evaluators import make_evaluator
from sympol.search.front.config import SearchConfig
from sympol.search.front.messages import TaskRequest, load_candidates
from sympol.search.front.methods import has_state_graph, run_tabular
from sympol.search.front.task import TaskContext


def test_a_tree_takes_the_shortest_path_and_smaller_ones_are_saved(tmp_path: Path):
    name = "MiniGrid-DistShift1-v0"
    spec = resolve(name)
    request = TaskRequest(SearchConfig(name), tmp_path, "teacher", 0, Budget(steps=2e8))
    run_tabular(TaskContext(request, spec))
    saved = load_candidates(tmp_path / "teacher" / "0")
    found = saved.candidates
    assert saved.finished
    returns = make_evaluator(spec, 7).play([one.tree for one in found], range(4)).returns.mean(axis=1)
    assert returns.max() == pytest.approx(1 - 0.9 * 13 / 252)  # 13 steps are the fewest
    best = found[int(returns.argmax())]
    assert best.method.startswith("tabular")
    assert best.tree.n_nodes < 20
    assert len({one.tree.n_nodes for one in found}) > 2
    assert all(one.cost.env_steps > 0 for one in found)


def test_only_small_environments_list_their_states():
    assert has_state_graph(resolve("MiniGrid-LavaGapS5-v0"))
    assert not has_state_graph(resolve("CartPole-v1"))
    assert not has_state_graph(resolve("MiniGrid-FourRooms-v0"))
    assert not has_state_graph(resolve("FrozenLake-v1"))
