"""A tree pruned on a list of observations acts the same on each of them, and nothing in it is idle there."""

from __future__ import annotations

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions, Group, prune_on

from .samples import (
    ACTIONS,
    consistent,
    every_cell,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
    within_bounds,
)


def same_actions(tree: DecisionTree, other: DecisionTree, x: np.ndarray) -> bool:
    return tree.predict(x).tobytes() == other.predict(x).tobytes()


def assert_no_split_is_idle(tree: DecisionTree, x: np.ndarray) -> None:
    """Wherever one child stood in its parent's place, some observation would meet another action."""
    action, path = tree.actions.decide(tree.value), tree.decision_path(x)
    for split in np.flatnonzero(~tree.is_leaf):
        for child in (int(tree.children_left[split]), int(tree.children_right[split])):
            answers = ((plain_leaf(tree, row, child), plain_leaf(tree, row)) for row in x[path[:, split]])
            assert any(action[a].tobytes() != action[b].tobytes() for a, b in answers)


@pytest.mark.parametrize("kind", ACTIONS)
def test_the_same_on_each_of_them_and_nothing_idle_is_left(kind):
    rng = np.random.default_rng(0)
    removed = 0
    for _ in range(60):
        tree = random_tree(rng, ACTIONS[kind], depth=int(rng.integers(6)), n_features=int(rng.integers(1, 4)))
        x = telling_observations(tree, rng, int(rng.choice([1, 2, 5, 20, 200])))
        small = prune_on(tree, x)
        assert small.n_nodes <= tree.n_nodes
        assert small.n_node_samples is None
        assert same_actions(tree, small, x)
        assert prune_on(small, x) == prune_on(small, x[::-1]) == small
        assert_no_split_is_idle(small, x)
        removed += tree.prune(bounds=False).n_nodes - small.n_nodes
    assert removed > 100


@pytest.mark.parametrize("kind", ACTIONS)
def test_after_pruning_by_groups_and_bounds(kind):
    rng = np.random.default_rng(1)
    checked = 0
    for _ in range(30):
        tree = random_grouped_tree(rng, ACTIONS[kind], int(rng.integers(2, 6)))
        x = within_bounds(tree, consistent(tree, every_cell(tree, nan=False)))
        if len(x) == 0:
            continue
        everything, some = tree.prune(observations=x), tree.prune(observations=x[::3])
        assert some.n_nodes <= everything.n_nodes <= tree.prune().n_nodes
        assert same_actions(tree, everything, x)
        assert same_actions(tree, some, x[::3])
        assert_no_split_is_idle(some, x[::3])
        checked += 1
    assert checked > 15


def test_without_merging_every_leaf_that_is_reached_stays():
    rng = np.random.default_rng(2)
    for _ in range(40):
        tree = random_tree(rng, ACTIONS["discrete"], depth=4)
        x = telling_observations(tree, rng, 10)
        small = tree.prune(bounds=False, merge=False, observations=x)
        assert (tree.value[tree.apply(x)] == small.value[small.apply(x)]).all()
        assert small.n_leaves == len(np.unique(tree.apply(x)))
        assert small.n_nodes >= prune_on(tree, x).n_nodes


def test_a_split_goes_where_the_list_leaves_it_nothing_to_say():
    # x0 <= 0 ? (x0 <= -1 ? 0 : 0) : x1 <= 0 ? 0 : 1
    tree = DecisionTree.from_complete(
        np.array([0, 0, 1]), np.array([0, -1, 0.0]), np.eye(2)[[0, 0, 0, 1]], actions=DiscreteActions(2)
    )
    assert prune_on(tree, [[-1, 0], [1, 0]]).n_nodes == 1
    assert prune_on(tree, [[-1, 0], [1, 0], [1, 1]]).feature.tolist() == [1, -2, -2]
    assert prune_on(tree, [[-1, 1], [1, 0], [1, 1]]).feature.tolist() == [0, -2, 1, -2, -2]
    assert prune_on(tree, [-1, 1]).predict([[9, 9]]) == 0


def test_what_cannot_be_pruned_on():
    group = Group("front", (0, 1), ("wall", "lava"))
    tree = DecisionTree.from_complete(
        np.array([1]), np.array([0.5]), np.eye(2), actions=DiscreteActions(2), groups=[group]
    )
    with pytest.raises(ValueError, match="at least one observation to prune on, got none"):
        prune_on(tree, np.zeros((0, 2)))
    with pytest.raises(ValueError, match="group 'front' must be a single 1"):
        tree.prune(observations=[[1, 0], [1, 1]])
    with pytest.raises(ValueError, match="expected observations of shape"):
        prune_on(tree, [[1, 0, 0]])
    with pytest.raises(TypeError, match="an observation holds real numbers"):
        prune_on(tree, [["wall", "lava"]])
