"""The evaluator of tables brings what the compiled one does, to the bit, for every tree and episode."""

from __future__ import annotations

import numpy as np
import pytest

from sympol.distill.cart import fit_cart
from sympol.search.evaluators import Returns, make_evaluator, tabular
from sympol.search.evaluators.jax import JaxEvaluator
from sympol.search.evaluators.tabular import TabularEvaluator

from .loops import SEED, assert_same, grown, spec_of

WORLDS = ["MiniGrid-Empty-Random-6x6-v0", "MiniGrid-DoorKey-5x5-v0", "MiniGrid-LavaGapS7-v0"]


@pytest.mark.parametrize("name", WORLDS)
def test_episodes_are_those_of_the_compiled_arena(name, monkeypatch):
    spec = spec_of(name)
    ours, theirs = make_evaluator(spec, SEED, "validation"), JaxEvaluator(spec, SEED, "validation")
    assert isinstance(ours, TabularEvaluator)
    trees = [grown(spec, 1 + n % 32, n) for n in range(150)]
    episodes = range(30, 60)
    played = ours.play(trees, episodes)
    assert_same(played, theirs.play(trees, episodes))
    monkeypatch.setattr(tabular, "BATCH_SIZE", 1000)  # in several batches
    again = ours.play(trees[:40], episodes)
    assert_same(again, Returns(*(part[:40] for part in played)))
    for tree in (trees[int(played.returns.mean(axis=1).argmax())], trees[0]):
        np.testing.assert_array_equal(ours.observe(tree, range(3, 9)), theirs.observe(tree, range(3, 9)))
    assert played.lengths.max() == spec.max_episode_steps, "no tree goes round for ever"
    assert (played.returns > 0).any() or "DoorKey" in name, "no tree ever arrives"


def test_where_only_keys_and_doors_lead_to_the_goal():
    """A large tree that does in each observation what most shortest ways do: no tree of a few leaves ever arrives."""
    spec = spec_of("MiniGrid-DoorKey-5x5-v0")
    graph = spec.state_graph()
    assert graph is not None
    successor, far = graph.successor, 10**6
    steps = np.where(graph.reaches_goal.any(axis=1), 1, far)
    after = np.zeros(0)
    for _ in range(50):
        after = np.where(graph.reaches_goal, 1, np.where(successor >= 0, steps[successor] + 1, far))
        steps = after.min(axis=1)
    shortest = (after == steps[:, None]) & (steps < far)[:, None]
    votes = np.zeros((len(graph.observations), successor.shape[1]), int)
    np.add.at(votes, graph.observation_of, shortest)
    tree = fit_cart(graph.observations, votes.argmax(axis=1), spec, depth=None, seed=0)
    played = TabularEvaluator(spec, SEED).play([tree], range(200))
    assert_same(played, JaxEvaluator(spec, SEED).play([tree], range(200)))
    assert tree.n_leaves > 20
    assert (played.returns > 0).any()
    assert (played.lengths == played.lengths.min()).sum() < 200


def test_worlds_that_are_too_large_or_no_grids_are_played_otherwise():
    for name in ("MiniGrid-FourRooms-v0", "CartPole-v1"):
        spec = spec_of(name)
        assert spec.state_graph() is None
        assert isinstance(make_evaluator(spec, SEED), JaxEvaluator)
