"""Growing finds the questions that are missing, and what is drawn is what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sympol.search.budget import Budget
from sympol.search.insert_splits import apply_insertions, insert_splits, resplit, sample_insertions
from sympol.search.prune_by_return import Effort
from sympol.trees import DecisionTree
from sympol.trees.edit import leaf_tree, subtree_end

from ..trees.samples import ACTIONS, random_tree
from .bandit import LENGTH, Bandit
from .test_finetune_thresholds import OFF, TRUTH, mean

QUICK = Effort(candidates=128, first=4, last=32, watched=8)


def drawn(kind: str, depth: int = 3) -> tuple[DecisionTree, np.ndarray]:
    """A random tree, and what it sees."""
    rng = np.random.default_rng(3)
    return random_tree(rng, ACTIONS[kind], depth), rng.normal(size=(200, 3)).astype(np.float32)


@pytest.mark.parametrize("kind", ACTIONS)
def test_a_sprout_leaves_one_side_as_it_was_and_gives_the_other_one_answer(kind):
    tree, x = drawn(kind)
    some = sample_insertions(tree, x, 100, np.random.default_rng(0))
    assert len({(one.node, one.part) for one in some}) == len(some) == 100
    before, leaf, nodes = tree.predict(x), tree.apply(x), set()
    for one in some:
        nodes.add(one.node)
        assert one.end == subtree_end(tree, one.node)
        new = apply_insertions(tree, [one])
        assert new.n_nodes == tree.n_nodes + 2
        here = (leaf >= one.node) & (leaf < one.end)
        left = x[:, one.part.feature[0]] <= one.part.threshold[0]
        assert (here & left).any()
        assert (here & ~left).any()
        other = here & (left if one.part.is_leaf[1] and one.part.n_nodes - 2 > 1 else ~left)
        if one.part.n_nodes == 3:  # above a leaf: the side that acts otherwise
            same = tree.actions.decide(one.part.value[1:2]) == tree.actions.decide(
                tree.value[one.node : one.node + 1]
            )
            other = here & (~left if bool(np.all(same)) else left)
        after = new.predict(x)
        np.testing.assert_array_equal(after[~other], before[~other])
        assert len(np.unique(after[other].reshape(other.sum(), -1), axis=0)) == 1
    assert nodes == {node for node in range(tree.n_nodes) if (leaf >= node).any()} & nodes
    assert any(not tree.is_leaf[node] for node in nodes)
    assert any(tree.is_leaf[node] for node in nodes)


def test_no_sprout_of_a_discrete_leaf_acts_as_the_leaf():
    tree, x = drawn("discrete")
    for one in sample_insertions(tree, x, 100, np.random.default_rng(1)):
        if tree.is_leaf[one.node]:
            assert (apply_insertions(tree, [one]).predict(x) != tree.predict(x)).any()


def test_sprouts_apart_are_planted_together():
    tree, x = drawn("discrete")
    some = sample_insertions(tree, x, 200, np.random.default_rng(2))
    left = next(one for one in some if one.node == 1)
    right = next(one for one in some if one.node == tree.children_right[0])
    root = next(one for one in some if one.node == 0)
    assert left.is_disjoint_from(right)
    assert right.is_disjoint_from(left)
    assert not root.is_disjoint_from(left)
    assert not left.is_disjoint_from(root)
    both, goes_left = apply_insertions(tree, [left, right]), x[:, tree.feature[0]] <= tree.threshold[0]
    assert both == apply_insertions(tree, [right, left])
    np.testing.assert_array_equal(
        both.predict(x)[goes_left], apply_insertions(tree, [left]).predict(x)[goes_left]
    )
    np.testing.assert_array_equal(
        both.predict(x)[~goes_left], apply_insertions(tree, [right]).predict(x)[~goes_left]
    )


def test_what_was_never_told_apart_is_not_asked_about():
    tree = leaf_tree(TRUTH, TRUTH.value[-1])
    x = np.zeros((10, 3), np.float32)
    x[:, 1] = np.arange(10) // 5
    some = sample_insertions(tree, x, 50, np.random.default_rng(0))
    assert {int(one.part.feature[0]) for one in some} == {1}
    assert {float(one.part.threshold[0]) for one in some} == {0.5}
    assert len(some) == 6  # three other answers, on either side; no more than there are
    assert sample_insertions(tree, x[:5], 50, np.random.default_rng(0)) == []


def test_a_leaf_grows_until_it_answers_as_the_best_tree_does():
    evaluator, leaf = Bandit(TRUTH), leaf_tree(OFF, OFF.value[-1])
    found = insert_splits(leaf, evaluator, nodes=15, budget=Budget(), effort=QUICK)
    assert mean(evaluator, leaf) < 0.4 * LENGTH
    assert mean(evaluator, found) > 0.85 * LENGTH
    assert 15 <= found.n_nodes <= 15 + 6
    again = insert_splits(leaf, Bandit(TRUTH), nodes=15, budget=Budget(), effort=QUICK)
    assert again == found
    assert insert_splits(leaf, Bandit(TRUTH), nodes=15, budget=Budget(), seed=1, effort=QUICK) != found


def test_where_nothing_is_to_be_gained_nothing_grows():
    evaluator = Bandit(TRUTH)
    assert insert_splits(TRUTH, evaluator, nodes=15, budget=Budget(), effort=QUICK) is TRUTH
    assert evaluator.steps > 0
    spent = Bandit(TRUTH)
    assert insert_splits(OFF, spent, nodes=7, budget=Budget(), effort=QUICK) is OFF  # it has as many
    assert insert_splits(OFF, spent, nodes=15, budget=Budget(steps=0), effort=QUICK) is OFF
    assert spent.steps == 0


def test_a_tree_that_asks_the_wrong_questions_asks_others_and_keeps_its_size():
    wrong = replace(OFF, feature=np.where(OFF.is_leaf, OFF.feature, 2))
    evaluator, found, limit = Bandit(TRUTH), wrong, {"max_nodes": wrong.n_nodes}
    for turn in range(3):
        found = resplit(
            found, evaluator, **limit, budget=Budget(steps=2_000_000), first_episode=turn << 20, seed=turn
        )
        assert found.n_nodes <= wrong.n_nodes
    assert mean(evaluator, wrong) < 0.6 * LENGTH
    assert mean(evaluator, found) > 0.9 * LENGTH
    again = [resplit(wrong, Bandit(TRUTH), **limit, budget=Budget(steps=300_000)) for _ in range(2)]
    assert again[0] == again[1] != wrong


def test_what_cannot_be_bettered_comes_back():
    assert resplit(TRUTH, Bandit(TRUTH), max_nodes=7, budget=Budget(steps=1_000_000)) is TRUTH
