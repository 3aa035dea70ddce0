"""Every step of pruning changes no action, and what can be dropped is dropped."""

import dataclasses

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, prune_unvisited

from .samples import ACTIONS, chain, every_cell, random_tree, telling_observations, within_bounds

STEPS = [
    {"bounds": False, "merge": False},
    {"bounds": False, "merge": True},
    {"bounds": True, "merge": False},
    {"bounds": True, "merge": True},
]


def same_actions(tree: DecisionTree, other: DecisionTree, x: np.ndarray) -> bool:
    return tree.predict(x).tobytes() == other.predict(x).tobytes()


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("steps", STEPS)
def test_no_action_changes(kind, steps):
    rng = np.random.default_rng(0)
    removed = 0
    for _ in range(40):
        tree = random_tree(rng, ACTIONS[kind], depth=int(rng.integers(6)), n_features=int(rng.integers(1, 4)))
        small = tree.prune(**steps)
        x = telling_observations(tree, rng, 2000)
        assert same_actions(tree, small, within_bounds(tree, x) if steps["bounds"] else x)
        assert small.prune(**steps) == small
        removed += tree.n_nodes - small.n_nodes
    assert removed > 100


@pytest.mark.parametrize("kind", ACTIONS)
def test_no_action_changes_in_any_cell(kind):
    rng = np.random.default_rng(2)
    for _ in range(60):
        tree = random_tree(rng, ACTIONS[kind], depth=3, n_features=2)
        everywhere = every_cell(tree, nan=True)
        assert same_actions(tree, tree.prune(bounds=False, merge=False), everywhere)
        assert same_actions(tree, tree.prune(bounds=False), everywhere)
        assert same_actions(tree, tree.prune(), within_bounds(tree, everywhere))


def tree_of(feature, threshold, choices, **changes) -> DecisionTree:
    """Make a complete tree whose leaves choose as told."""
    actions = DiscreteActions(3)
    return DecisionTree.from_complete(
        np.array(feature), np.array(threshold), np.eye(3)[choices], actions=actions, **changes
    )


def test_an_ancestor_decides():
    # x0 <= 0, and below it x0 <= 0 again on both sides
    tree = tree_of([0, 0, 0], [0.0, 0.0, -0.0], [0, 1, 2, 0])
    small = tree.prune(bounds=False, merge=False)
    assert small.n_nodes == 3
    assert small.predict([[0.0], [1.0], [np.nan]]).tolist() == [0, 0, 0]


def test_bounds_are_inclusive():
    def inner_nodes(low: float, high: float) -> int:
        return tree_of([0], [1.0], [0, 1], feature_low=[low], feature_high=[high]).prune().n_nodes // 2

    assert inner_nodes(0.0, 1.0) == 0
    assert inner_nodes(0.0, np.nextafter(np.float32(1), np.float32(2))) == 1
    assert inner_nodes(1.0, 2.0) == 1
    assert inner_nodes(np.nextafter(np.float32(1), np.float32(2)), 2.0) == 0
    assert inner_nodes(-np.inf, np.inf) == 1
    largest = np.finfo(np.float32).max
    assert inner_nodes(-largest, largest) == 1


def test_equal_subtrees_become_one():
    tree = tree_of([0, 1, 1], [0.0, 1.0, 1.0], [0, 1, 0, 1])
    assert tree.prune().n_nodes == 3
    assert tree.prune(merge=False).n_nodes == 7


def test_a_split_that_only_repeats_its_neighbour_is_idle():
    # x0 <= 0 ? (x0 <= -1 ? a : b) : b   is   x0 <= -1 ? a : b
    tree = tree_of([0, 0, 1], [0.0, -1.0, 5.0], [0, 1, 1, 1])
    small = tree.with_visits([[-2.0, 0.0], [-0.5, 0.0], [3.0, 0.0], [4.0, 9.0]]).prune()
    assert small.threshold.tolist() == [-1, -2, -2]
    assert small.n_node_samples is not None
    assert small.n_node_samples.tolist() == [4, 1, 3]
    # and mirrored: x0 <= 0 ? a : (x0 <= 1 ? a : b)
    assert tree_of([0, 1, 0], [0.0, 5.0, 1.0], [0, 0, 0, 1]).prune().threshold.tolist() == [1, -2, -2]


def test_clipped_actions_that_are_equal_merge():
    actions = BoxActions(-1, 1, (1,))
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([0.0]), np.array([[2.0], [3.0]]), actions=actions
    )
    assert tree.with_visits([[1.0]]).prune().value.tolist() == [[3]]
    assert tree.prune().value.tolist() == [[2]]


def test_merged_probabilities_are_the_visit_weighted_mean():
    values = np.log([[0.9, 0.1], [0.6, 0.4]])
    tree = DecisionTree.from_complete(np.array([0]), np.array([0.0]), values, actions=DiscreteActions(2))
    merged = tree.with_visits([[0.0], [1.0], [1.0]]).prune()
    assert np.allclose(merged.predict_proba([0.0]), [0.7, 0.3])


def test_a_mean_that_would_change_the_action_is_not_taken():
    # the difference is lost in the probabilities, and then the lower index would win
    values = np.array([[0.0, 1e-30], [0.0, 2e-30]])
    tree = DecisionTree.from_complete(np.array([0]), np.array([0.0]), values, actions=DiscreteActions(2))
    merged = tree.with_visits([[0.0], [1.0], [1.0]]).prune()
    assert merged.n_nodes == 1
    assert merged.value.tolist() == [[0, np.float32(2e-30)]]


def test_unvisited_branches_go_and_that_changes_the_policy():
    tree = tree_of([0, 1, 1], [0.0, 0.0, 0.0], [0, 1, 2, 0])
    seen = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])
    small = prune_unvisited(tree.with_visits(seen))
    assert small.n_nodes == 5
    assert same_actions(tree, small, seen)
    assert not same_actions(tree, small, np.array([[-1.0, 1.0]]))
    with pytest.raises(ValueError, match="with_visits"):
        prune_unvisited(tree)


@pytest.mark.parametrize("to_left", [True, False])
def test_a_long_chain(to_left):
    tree = chain(1500, to_left=to_left, actions=DiscreteActions(2))
    assert tree.prune() == tree
    alike = dataclasses.replace(tree, value=np.zeros_like(tree.value))
    assert alike.prune().n_nodes == 1
