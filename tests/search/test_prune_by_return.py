"""Pruning by return: against brute force in an evaluator whose returns can be worked out."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from sympol.search.prune_by_return import Effort, default_effort, prune_by_return, prune_path
from sympol.search.prunings import apply_prunings, prune_moves
from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.edit import graft, leaf_tree, split_tree, subtree, subtree_end
from tests.search.bandit import LENGTH, Bandit
from tests.trees.samples import ACTIONS, random_tree

QUICK = Effort(candidates=1000, first=8, last=32, watched=16)
"""Little effort: as many moves as candidates, and few episodes."""
FULL = Effort(candidates=1000, first=16, last=16, watched=16)
"""All candidates play all episodes: the search is exhaustive."""


def drawn(rng: np.random.Generator, kind: str = "discrete", depth: int = 4) -> DecisionTree:
    """A random tree; the evaluator's observations know no bounds."""
    tree, nowhere = random_tree(rng, ACTIONS[kind], depth), np.full(3, np.inf)
    return replace(tree, feature_low=-nowhere, feature_high=nowhere, n_node_samples=None)


def walked(tree: DecisionTree, x: np.ndarray, node: int, child: int) -> list[int]:
    """The leaf of each observation where, at one node, everything goes to one child."""
    leaves = []
    for row in x:
        at = 0
        while not tree.is_leaf[at]:
            left = row[tree.feature[at]] <= tree.threshold[at]
            at = child if at == node else int((tree.children_left if left else tree.children_right)[at])
        leaves.append(at)
    return leaves


@pytest.mark.parametrize("kind", ACTIONS)
def test_a_cut_sends_everything_one_way_and_says_what_that_changes(kind):
    rng = np.random.default_rng(0)
    tree = drawn(rng, kind, 3)
    x = rng.normal(size=(150, 3)).astype(np.float32)
    before = tree.predict(x).reshape(len(x), -1)
    found = prune_moves(tree, x)
    assert [move.change for move in found] == sorted(move.change for move in found)
    plain = 0
    for move in found:
        small = apply_prunings(tree, [move])
        assert small.n_nodes == tree.n_nodes - move.removed
        after = small.predict(x).reshape(len(x), -1)
        if kind == "box":
            change = np.square(after.astype(float) - before).sum() / len(x)
        else:
            change = (after != before).any(axis=1).mean()
        assert move.change == pytest.approx(change)
        children = (int(tree.children_left[move.node]), int(tree.children_right[move.node]))
        for child in children:
            if small == apply_prunings(tree, [move._replace(part=subtree(tree, child))]):
                leaves = walked(tree, x, move.node, child)
                np.testing.assert_array_equal(small.predict(x), tree.actions.decide(tree.value[leaves]))
                plain += 1
    assert plain >= 2 * 7  # both sides of each of seven splits, as they are


@pytest.mark.parametrize("kind", ACTIONS)
def test_other_answers_are_the_nearest_to_what_was_done(kind):
    """Where a leaf answers otherwise than before, no answer of the tree would change less."""
    rng = np.random.default_rng(1)
    tree = drawn(rng, kind, 4)
    x = rng.normal(size=(300, 3)).astype(np.float32)
    wanted = tree.predict(x).reshape(len(x), -1).astype(float)
    sides = {subtree(tree, child) for child in range(1, tree.n_nodes)}

    def off(rows: np.ndarray, answer: np.ndarray) -> float:
        differs = wanted[rows] - answer
        return float(np.square(differs).sum() if kind == "box" else differs.any(axis=1).sum())

    refitted = 0
    for move in prune_moves(tree, x):
        if move.part in sides:
            continue
        children = (int(tree.children_left[move.node]), int(tree.children_right[move.node]))
        as_it_was = next(
            part for child in children if _questions(part := subtree(tree, child)) == _questions(move.part)
        )
        before, small = (apply_prunings(tree, [move._replace(part=part)]) for part in (as_it_was, move.part))
        leaves = small.apply(x)
        for leaf in np.unique(leaves):
            if (small.value[leaf] != before.value[leaf]).any():
                rows, given = leaves == leaf, small.actions.decide(small.value[[leaf]]).reshape(-1)
                assert (
                    off(rows, given) <= min(off(rows, answer) for answer in np.unique(wanted, axis=0)) + 1e-4
                )
                refitted += 1
    assert refitted > 3


def _questions(tree: DecisionTree) -> tuple[bytes, bytes]:
    return tree.feature.tobytes(), tree.threshold.tobytes()


def test_of_cuts_within_each_other_the_outer_counts():
    rng = np.random.default_rng(2)
    tree = drawn(rng)
    x = rng.normal(size=(50, 3)).astype(np.float32)
    found = {move.node: move for move in prune_moves(tree, x)}
    outer, inner, behind = found[1], found[2], found[tree.children_right[0]]
    assert subtree_end(tree, 1) > 2
    both = apply_prunings(tree, [inner, behind, outer])
    assert both == graft(graft(tree, behind.node, behind.part), 1, outer.part)
    assert apply_prunings(tree, [outer, inner]) == apply_prunings(tree, [outer])


@pytest.mark.parametrize("kind", ACTIONS)
def test_a_step_makes_the_cut_that_costs_least(kind):
    rng = np.random.default_rng(3)
    teacher = drawn(rng, kind, 3)
    evaluator = Bandit(teacher, seed=1)
    tree = teacher.prune(bounds=False)
    tree = tree.prune(observations=evaluator.observe(tree, range(16)))
    found = prune_path(tree, evaluator, smallest=1, effort=FULL)
    for big, small in itertools.pairwise(found):
        options = [
            apply_prunings(big.tree, [move])
            for move in prune_moves(big.tree, evaluator.observe(big.tree, range(16)))
        ]
        means = [evaluator.returns_of(option, range(16)).mean(dtype=float) for option in options]
        chosen = evaluator.returns_of(small.tree, range(16)).mean(dtype=float)
        idle = big.tree.prune(observations=evaluator.observe(big.tree, range(16))).n_nodes < big.tree.n_nodes
        assert idle or chosen == pytest.approx(max(means))


@pytest.mark.parametrize("kind", ACTIONS)
def test_a_chain_falls_from_the_tree_to_a_leaf_and_knows_its_returns(kind):
    rng = np.random.default_rng(4)
    tree = drawn(rng, kind, 5)
    evaluator = Bandit(tree, seed=2)
    told = []
    found = prune_path(tree, evaluator, effort=QUICK, first_episode=50, progress=told.append)
    sizes = [each.tree.n_nodes for each in found]
    assert sizes == sorted({*sizes}, reverse=True)
    assert sizes[-1] == 1
    assert found[0].tree == tree.prune()
    assert [each.tree for each in told] == [each.tree for each in found]
    for each in found:
        np.testing.assert_array_equal(each.returns, evaluator.returns_of(each.tree, range(82, 114)))
        assert each.tree.prune() == each.tree
    again = prune_path(tree, Bandit(tree, seed=2), effort=QUICK, first_episode=50)
    assert [each.tree for each in again] == [each.tree for each in found]


@pytest.mark.parametrize("most", [1, 3, 5, 9, 21])
def test_it_is_never_larger_than_it_may_be_and_no_smaller_than_it_is(most):
    tree = drawn(np.random.default_rng(5), depth=6)
    found = prune_by_return(tree, Bandit(tree), max_nodes=most, effort=QUICK).tree
    assert found.n_nodes <= most
    small = tree.prune()
    assert prune_by_return(small, Bandit(tree), max_nodes=small.n_nodes, effort=QUICK).tree == small


def overgrown(teacher: DecisionTree, rng: np.random.Generator) -> DecisionTree:
    """The teacher under questions that it does not need: nearly nobody comes by, or nothing comes of it."""
    tree = teacher
    for _ in range(6):
        leaf = int(rng.choice(np.flatnonzero(tree.is_leaf)))
        wrong = leaf_tree(tree, np.roll(tree.value[leaf], 1))
        right = leaf_tree(tree, tree.value[leaf])
        tree = graft(tree, leaf, split_tree(int(rng.integers(3)), -4.5, wrong, right))
    return split_tree(1, 4.5, tree, leaf_tree(tree, tree.value[np.flatnonzero(tree.is_leaf)[0]]))


def teacher_of_seven() -> DecisionTree:
    leaves = np.eye(4)[[0, 1, 2, 3]]
    return DecisionTree.from_complete(
        np.array([0, 1, 2]), np.array([0.1, -0.2, 0.3]), leaves, actions=DiscreteActions(4)
    )


def test_what_earns_nothing_goes_and_the_rest_stays():
    rng, teacher = np.random.default_rng(6), teacher_of_seven()
    tree = overgrown(teacher, rng)
    assert tree.n_nodes == 7 + 6 * 2 + 2
    found = prune_by_return(tree, Bandit(teacher), effort=QUICK)
    assert found.tree == replace(teacher, n_node_samples=None)
    assert found.mean == LENGTH


def test_a_price_decides_what_a_node_is_worth():
    """Each question of the teacher's is worth about a quarter of the answers, two and a half for each of its nodes."""
    teacher = teacher_of_seven()
    sizes = [
        prune_by_return(teacher, Bandit(teacher), node_price=price, effort=QUICK).tree.n_nodes
        for price in (0.0, 0.5, 3.5, 10.0)
    ]
    assert sizes[:2] == [7, 7]
    assert sizes[-1] == 1
    assert sizes == sorted(sizes, reverse=True)
    both = prune_by_return(teacher, Bandit(teacher), max_nodes=5, node_price=0.5, effort=QUICK)
    assert both.tree.n_nodes == 5  # forced to five, and the price lets it stay there


def test_where_nothing_may_be_lost_nothing_is_lost():
    for seed in range(5):
        tree = drawn(np.random.default_rng(seed), depth=5)
        evaluator = Bandit(tree, seed)
        found = prune_by_return(tree, evaluator, effort=QUICK)
        assert found.mean >= evaluator.returns_of(tree, range(32, 64)).mean() - 1e-6


def test_what_can_not_be_seen_counts_for_nothing():
    tree = drawn(np.random.default_rng(7), depth=5)
    listed = np.random.default_rng(8).normal(size=(12, 3)).astype(np.float32)
    found = prune_path(tree, Bandit(tree), effort=QUICK, observations=listed)
    assert found[0].tree == tree.prune(observations=listed)


def test_a_slow_arena_is_asked_for_less():
    """Of each step the effort says how many moves play, and how often."""
    rng = np.random.default_rng(9)
    questions = rng.integers(12, size=127), 0.5 * rng.normal(size=127), rng.normal(size=(128, 3))
    tree = DecisionTree.from_complete(*questions, actions=DiscreteActions(3))
    evaluator = Bandit(tree, hosted=True)
    effort = default_effort(evaluator)
    assert effort.candidates < default_effort(Bandit(tree)).candidates
    found = prune_path(tree, evaluator, smallest=31)
    assert max(number for number, _ in evaluator.calls) <= effort.candidates + 1
    assert max(episodes.stop for _, episodes in evaluator.calls) <= 2 * effort.last
    rounds = 5 * effort.candidates * effort.first + 4 * effort.last  # each round plays as much as the first
    assert evaluator.steps / LENGTH <= len(found) * rounds
    assert len(found) < (found[0].tree.n_nodes - 31) / 2  # many prune_moves a step while it is large


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"max_nodes": 4}, "max_nodes must be odd and at least 1, got 4"),
        ({"max_nodes": 0}, "max_nodes must be odd and at least 1, got 0"),
        ({"node_price": -0.5}, "node_price must be a return, 0 or more, got -0.5"),
        ({"node_price": np.inf}, "node_price must be a return"),
    ],
)
def test_what_makes_no_sense_is_refused(how, said):
    tree = teacher_of_seven()
    with pytest.raises(ValueError, match=re.escape(said)):
        prune_by_return(tree, Bandit(tree), **how)


def test_a_tree_for_something_else_is_refused():
    tree = random_tree(np.random.default_rng(10), BoxActions((-1,), (1,), (1,)))
    with pytest.raises(ValueError, match="cannot play bandit"):
        prune_by_return(teacher_of_seven(), Bandit(tree))
