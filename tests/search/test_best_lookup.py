"""The best policy without memory: as good as anything where that is possible, and what a program proved elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sympol.envs.capabilities import UNREACHABLE, steps_to_goal
from sympol.envs.minigrid.state_graph import all_starts
from sympol.search.best_lookup import best_lookup
from sympol.search.budget import Budget
from sympol.search.evaluators.tabular import TabularEvaluator, play_table
from tests.envs import minigrid_worlds

from .loops import spec_of

FOUND_BY_MILP = json.loads(Path("studies/results/memoryless.json").read_text(encoding="utf-8"))["tasks"]


@pytest.mark.parametrize(
    "name", ["MiniGrid-DistShift1-v0", "MiniGrid-LavaGapS5-v0", "MiniGrid-Empty-Random-6x6-v0"]
)
def test_it_is_as_good_as_the_best_that_a_mixed_integer_program_finds(name):
    spec = spec_of(name)
    graph = spec.state_graph()
    assert graph is not None
    table = best_lookup(TabularEvaluator(spec, 3), budget=Budget(steps=1e8), seed=1)
    act = np.zeros(len(graph.observations), int)
    number = {row.tobytes(): i for i, row in enumerate(graph.observations)}
    act[[number[row.tobytes()] for row in table.observations]] = table.actions
    starts, probability = minigrid_worlds.all_starts(spec.env)
    where = graph.index(starts)
    best = graph.reward_at[steps_to_goal(graph.successor, graph.reaches_goal)[where]]
    share = (play_table(graph, act[None], where).returns[0] / best) @ probability
    assert share == pytest.approx(FOUND_BY_MILP[name]["share_found"], abs=1e-4)
    assert table.is_best == (FOUND_BY_MILP[name]["share_bound"] > 1 - 1e-6)


def test_steps_to_the_goal_are_those_of_another_program():
    """Breadth first, from the goal backwards."""
    spec = spec_of("MiniGrid-DoorKey-5x5-v0")
    graph = spec.state_graph()
    assert graph is not None
    theirs = np.full(len(graph.observation_of), UNREACHABLE)
    reached, steps = np.flatnonzero(graph.reaches_goal.any(axis=1)), 1
    while len(reached):
        theirs[reached], steps = steps, steps + 1
        before = np.isin(graph.successor, reached).any(axis=1)
        reached = np.flatnonzero(before & (theirs == UNREACHABLE))
    np.testing.assert_array_equal(steps_to_goal(graph.successor, graph.reaches_goal), theirs)
    assert len(set(theirs.tolist())) > 10


def test_the_table_says_what_to_do_wherever_it_leads():
    """And nothing about what it never sees."""
    spec = spec_of("MiniGrid-LavaGapS5-v0")
    graph = spec.state_graph()
    assert graph is not None
    table = best_lookup(TabularEvaluator(spec, 0), budget=Budget(steps=1e6))
    does = {row.tobytes(): int(action) for row, action in zip(table.observations, table.actions, strict=True)}
    asked, starts = set(), all_starts(spec.env)
    assert starts is not None
    for state in graph.index(starts).tolist():
        while state >= 0:
            seen = graph.observations[graph.observation_of[state]].tobytes()
            asked.add(seen)
            state = int(graph.successor[state, does[seen]])
    assert asked == set(does)


def test_the_same_seed_and_steps_end_alike():
    spec = spec_of("MiniGrid-LavaGapS7-v0")
    first, again, other = (
        best_lookup(TabularEvaluator(spec, 0), budget=Budget(steps=3e7), seed=seed) for seed in (4, 4, 5)
    )
    assert first.steps == again.steps != other.steps
    np.testing.assert_array_equal(first.actions, again.actions)
    assert 0.3 < first.mean < 0.96
    assert not first.is_best
