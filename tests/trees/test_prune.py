"""Every step of pruning changes no action, and what can be dropped is dropped."""

import dataclasses
import sys

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, prune, prune_on, prune_unvisited

from .samples import (
    ACTIONS,
    chain,
    consistent,
    every_cell,
    plain_leaf,
    random_grouped_tree,
    random_tree,
    telling_observations,
    within_bounds,
)

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


def assert_nothing_is_left(tree: DecisionTree, x: np.ndarray) -> None:
    """Check on all kinds of observations that each split is asked for, and that neither child answers for both."""
    path, action = tree.decision_path(x), tree.predict(x).reshape(len(x), -1)
    for split in np.flatnonzero(~tree.is_leaf):
        left, right = int(tree.children_left[split]), int(tree.children_right[split])
        for kept, dropped in ((left, right), (right, left)):
            seen = path[:, dropped]
            assert seen.any()
            answers = tree.actions.decide(tree.value[[plain_leaf(tree, row, kept) for row in x[seen]]])
            assert (answers.reshape(-1, action.shape[1]) != action[seen]).any()


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("bounds", [False, True])
def test_what_groups_and_bounds_tell_is_used_up(kind, bounds):
    rng = np.random.default_rng(5)
    removed = checked = 0
    for _ in range(60):
        sizes = tuple(rng.integers(1, 5, size=rng.integers(3)).tolist())
        tree = random_grouped_tree(
            rng, ACTIONS[kind], int(rng.integers(5)), sizes, int(rng.integers(not sizes, 3))
        )
        x = consistent(tree, every_cell(tree, nan=not bounds))
        x = within_bounds(tree, x) if bounds else x
        small, only_decided = tree.prune(bounds=bounds), tree.prune(bounds=bounds, merge=False)
        assert small.n_nodes <= only_decided.n_nodes <= tree.n_nodes
        assert small.prune(bounds=bounds) == only_decided.prune(bounds=bounds) == small
        if len(x):
            assert same_actions(tree, small, x)
            assert (tree.value[tree.apply(x)] == only_decided.value[only_decided.apply(x)]).all()
            assert only_decided.decision_path(x).any(axis=0).all()
            assert_nothing_is_left(small, x)
            checked += 1
        removed += tree.n_nodes - small.n_nodes
    assert checked > 40
    assert removed > 300


@pytest.mark.parametrize("patience", [0, 1, 4])
def test_without_patience_trees_are_larger_and_act_the_same(patience, monkeypatch):
    monkeypatch.setattr(sys.modules[prune.__module__], "_LEAST_PATIENCE", 0)
    monkeypatch.setattr(sys.modules[prune.__module__], "_PATIENCE", patience)
    rng = np.random.default_rng(6)
    for _ in range(40):
        tree = random_grouped_tree(rng, ACTIONS["discrete"], 5)
        small = tree.prune(bounds=False)
        assert same_actions(tree, small, consistent(tree, every_cell(tree, nan=True)))
        assert small.prune(bounds=False) == small


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


def test_a_category_decides_about_the_others():
    # lava?; if not: wall?; then everything is known
    tree = tree_of(
        [2, 1, 0, 0, 2, 0, 1],
        [0.5] * 7,
        [2, 1, 0, 2, 1, 2, 2, 2],
        feature_names=["empty", "wall", "lava"],
        groups=[Group("front", (0, 1, 2), ("empty", "wall", "lava"))],
    )
    small = tree.prune(bounds=False, merge=False)
    assert small.rules() == [
        "If front is lava: action 1.",
        "If front is wall: action 0.",
        "If front is empty: action 1.",
    ]
    seen = small.with_visits([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]).prune(bounds=False)
    assert seen.rules() == ["If front is wall: action 0 (25 %).", "If front is not wall: action 1 (75 %)."]


def test_bounds_rule_categories_out():
    def inner_nodes(low: list[float], high: list[float]) -> int:
        group = Group("door", (0, 1, 2), ("open", "shut", "locked"))
        tree = tree_of([0, 1, 1], [0.5] * 3, [0, 1, 2, 2], feature_low=low, feature_high=high, groups=[group])
        return tree.prune().n_nodes // 2

    assert inner_nodes([0, 0, 0], [1, 1, 1]) == 2
    assert inner_nodes([0, 0, 0], [1, 0.9, 1]) == 1
    assert inner_nodes([0, 0, 0.1], [1, 1, 1]) == 0
    assert inner_nodes([0, 0, 0], [0, 0, 1]) == 0
    # no category is left: such bounds say nothing
    assert inner_nodes([0, 0, 0], [0, 0, 0]) == 2
    assert inner_nodes([0.1, 0.1, 0], [1, 1, 1]) == 2
    assert inner_nodes([0, 2, 0], [0, 3, 1]) == 2


@pytest.mark.parametrize("mirrored", [False, True])
def test_where_either_side_could_stay_the_smaller_one_does(mirrored):
    # both sides: x3 <= 0 ? x2 : x1, but one asks for x1 first, and then has six leaves instead of four
    asks_x1_first = [[1], [3, 3], [2, 0, 2, 0]], [0, 1, 0, 0, 0, 1, 1, 1]
    asks_x3_first = [[3], [2, 1], [0, 0, 0, 0]], [0, 0, 1, 1, 0, 0, 1, 1]
    first, second = (asks_x3_first, asks_x1_first) if mirrored else (asks_x1_first, asks_x3_first)
    levels = [a + b for a, b in zip(first[0], second[0], strict=True)]
    tree = tree_of([0, *levels[0], *levels[1], *levels[2]], [0.0] * 15, first[1] + second[1])
    everywhere = every_cell(tree, nan=True)
    for small in (tree.prune(), prune_on(tree, everywhere)):
        assert small.feature[~small.is_leaf].tolist() == [3, 2, 1]
        assert same_actions(tree, small, everywhere)


def test_visits_are_given_up_only_where_they_would_be_shared():
    # x0 <= 0 ? (x1 <= 0 ? a : x2 <= 0 ? (x0 <= -1 ? a : b) : b) : (x1 <= 0 ? a : b), the right side is idle
    tree = tree_of(
        [0, 1, 1, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        [0.0] * 9 + [-1.0] + [0.0] * 5,
        [0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1],
    )
    left = [[-2, -1, 0], [-2, 1, -1], [-0.5, 1, -1], [-0.5, 1, 1]]
    counted = tree.with_visits([*left, [1, -1, 0]]).prune()
    assert counted.feature.tolist() == [1, -2, 2, 0, -2, -2, -2]
    assert counted.n_node_samples is not None
    assert counted.n_node_samples.tolist() == [5, 2, 3, 2, 1, 1, 1]
    # the right side's b answers where the left side has two leaves
    uncounted = tree.with_visits([*left, [1, 1, 0]]).prune()
    assert uncounted.n_node_samples is None


@pytest.mark.parametrize("to_left", [True, False])
def test_a_long_chain(to_left):
    tree = chain(1500, to_left=to_left, actions=DiscreteActions(2))
    assert tree.prune() == tree
    alike = dataclasses.replace(tree, value=np.zeros_like(tree.value))
    assert alike.prune().n_nodes == 1
