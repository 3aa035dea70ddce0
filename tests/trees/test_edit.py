from typing import Any

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, MultiDiscreteActions
from sympol.trees.edit import cut, graft, set_action, set_feature, set_threshold, split_tree, subtree
from sympol.trees.name_lookup import SURE

from .samples import ACTIONS, HOSTILE_NAMES, plain_leaf, random_tree, telling_observations

ANSWERS: dict[str, Any] = {"discrete": "right", "multi_discrete": ["on", "none"], "box": [[0.25], [-0.5]]}
PREDICTED: dict[str, Any] = {"discrete": 1, "multi_discrete": [1, 1], "box": [[0.25], [-0.5]]}


def kinds(n: int = 6):
    for kind in ACTIONS:
        for seed in range(n):
            rng = np.random.default_rng(seed)
            tree = random_tree(rng, ACTIONS[kind], depth=3)
            yield kind, tree, telling_observations(tree, rng, 300), rng


def small(feature: list[int], threshold: list[float], values: Any, **space: Any) -> DecisionTree:
    return DecisionTree.from_complete(np.array(feature, int), np.array(threshold), np.array(values), **space)


def below(tree: DecisionTree, node: int, x: np.ndarray) -> np.ndarray:
    """Which observations come by a node, in a loop nobody can misread."""
    after = node
    while tree.children_right[after] != -1:
        after = int(tree.children_right[after])
    return np.array([node <= plain_leaf(tree, row) <= after for row in x])


def everything_else_is_kept(tree: DecisionTree, edited: DecisionTree) -> None:
    for name in ("feature_names", "groups", "integers", "actions", "meta"):
        assert getattr(edited, name) == getattr(tree, name)
    np.testing.assert_array_equal(edited.feature_low, tree.feature_low)
    assert edited.n_node_samples is None


def test_a_cut_subtree_answers_as_told_and_all_else_as_before():
    for kind, tree, x, rng in kinds():
        node = int(rng.choice(np.flatnonzero(~tree.is_leaf)))
        edited, here, before = cut(tree, node, ANSWERS[kind]), below(tree, node, x), tree.predict(x)
        after = edited.predict(x)
        assert here.any() or node
        np.testing.assert_array_equal(after[~here], before[~here])
        np.testing.assert_array_equal(after[here], np.broadcast_to(PREDICTED[kind], after[here].shape))
        assert edited.is_leaf[node]
        everything_else_is_kept(tree, edited)


def test_without_an_action_a_cut_takes_the_most_visited_one():
    for _, tree, x, rng in kinds():
        node = int(rng.choice(np.flatnonzero(~tree.is_leaf)))
        tree = tree.with_visits(x)
        here = below(tree, node, x)
        if not here.any():
            continue
        actions, counts = np.unique(tree.predict(x)[here].reshape(here.sum(), -1), axis=0, return_counts=True)
        if (counts == counts.max()).sum() == 1:
            expected = actions[counts.argmax()]
            edited = cut(tree, node)
            got = edited.predict(x)[here].reshape(here.sum(), -1)
            np.testing.assert_array_equal(got, np.broadcast_to(expected, got.shape))
            # the leaf is one of those that stood there, and says no more than it did
            assert (tree.value == edited.value[node]).all(axis=1).any()


def test_where_nobody_came_by_a_cut_counts_leaves():
    tree = DecisionTree.from_complete(
        np.zeros(3, int), np.float32([0, -1, 1]), np.eye(2)[[0, 1, 1, 1]], actions=DiscreteActions(2)
    )
    assert cut(tree, 0).predict([0.0]) == 1
    never_left = tree.with_visits(np.full((5, 1), 2.0))
    assert cut(never_left, 1).predict([-1.0]) == 0  # of one leaf each, the first
    assert cut(tree.with_visits(np.full((5, 1), -2.0)), 0).predict([0.0]) == 0


def test_a_leaf_takes_the_action_it_is_given_and_no_other_leaf_does():
    for kind, tree, x, rng in kinds():
        leaf = int(rng.choice(np.flatnonzero(tree.is_leaf)))
        edited, leaves = set_action(tree, leaf, ANSWERS[kind]), tree.apply(x)
        np.testing.assert_array_equal(edited.apply(x), leaves)
        np.testing.assert_array_equal(edited.predict(x)[leaves != leaf], tree.predict(x)[leaves != leaf])
        got = edited.actions.decide(edited.value[[leaf]])[0]
        np.testing.assert_array_equal(got, PREDICTED[kind])
        everything_else_is_kept(tree, edited)


def test_names_numbers_and_options_say_the_same():
    for names, numbers in [("right", 1), ("left", -1)]:
        tree = random_tree(np.random.default_rng(0), ACTIONS["discrete"], depth=1)
        assert (
            set_action(tree, 1, names)
            == set_action(tree, 1, numbers)
            == set_action(tree, 1, np.int64(numbers))
        )
    tree = random_tree(np.random.default_rng(0), ACTIONS["multi_discrete"], depth=1)
    assert (
        set_action(tree, 1, ("on", "right"))
        == set_action(tree, 1, [1, 2])
        == set_action(tree, 1, np.array([1, 2]))
    )
    one = small([0], [0.0], [[0.0], [1.0]], actions=BoxActions(-2, 2, (1,)))
    assert set_action(one, 1, 0.5) == set_action(one, 1, [0.5])


def test_a_leaf_becomes_sure_but_not_beyond_training_on():
    tree = random_tree(np.random.default_rng(0), ACTIONS["discrete"], depth=0, n_features=1)
    chances = set_action(tree, 0, "stay").predict_proba([0.0])
    np.testing.assert_allclose(chances, [(1 - SURE) / 2, SURE, (1 - SURE) / 2], rtol=1e-5)
    only = small([], [], [[0.3]], actions=DiscreteActions(1), feature_names=["x"])
    assert set_action(only, 0, 0).predict([0.0]) == 0


def test_thresholds_and_features_change_one_question():
    for _, tree, x, rng in kinds(3):
        node = int(rng.choice(np.flatnonzero(~tree.is_leaf)))
        for edited in (set_threshold(tree, node, 0.1), set_feature(tree, node, "x[1]")):
            same = ~below(tree, node, x)
            np.testing.assert_array_equal(edited.predict(x)[same], tree.predict(x)[same])
            np.testing.assert_array_equal(edited.children_left, tree.children_left)
            everything_else_is_kept(tree, edited)
        assert set_threshold(tree, node, 0.1).threshold[node] == np.float32(0.1)
        assert set_feature(tree, node, 1) == set_feature(tree, node, "x[1]")
        assert set_feature(tree, node, 1).feature[node] == 1
        assert set_threshold(tree, node, 1e-40).threshold[node] == 0


def test_a_grafted_tree_answers_for_its_node_and_all_else_as_before():
    for kind, tree, x, rng in kinds():
        other = random_tree(np.random.default_rng(99), ACTIONS[kind], depth=2)
        node = int(rng.integers(tree.n_nodes))
        edited, here = graft(tree, node, other), below(tree, node, x)
        np.testing.assert_array_equal(edited.predict(x)[~here], tree.predict(x)[~here])
        np.testing.assert_array_equal(edited.predict(x)[here], other.predict(x)[here])
        everything_else_is_kept(tree, edited)
        assert graft(tree, node, subtree(tree, node)).to_json() == _uncounted(tree).to_json()


def test_a_subtree_is_what_is_below_a_node():
    for _, tree, x, _ in kinds(2):
        for node in range(tree.n_nodes):
            here = below(tree, node, x)
            part = subtree(tree, node)
            np.testing.assert_array_equal(part.predict(x[here]), tree.predict(x[here]))
            assert part.n_node_samples[0] == tree.n_node_samples[node]


def test_a_question_joins_two_trees():
    for kind, tree, x, _ in kinds(2):
        other = random_tree(np.random.default_rng(9), ACTIONS[kind], depth=2)
        joined = split_tree(2, 0.25, tree, other)
        left = x[:, 2] <= 0.25
        np.testing.assert_array_equal(joined.predict(x)[left], tree.predict(x)[left])
        np.testing.assert_array_equal(joined.predict(x)[~left], other.predict(x)[~left])


def _uncounted(tree: DecisionTree) -> DecisionTree:
    return set_threshold(tree, 0, float(tree.threshold[0]))


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda tree: cut(tree, 99), "a node must be from 0 to 6, got 99"),
        (lambda tree: cut(tree, -1), "a node must be from 0 to 6, got -1"),
        (
            lambda tree: cut(tree, 2),
            "node 2 is a leaf, which asks nothing: push left; inner nodes are 0, 1, 4",
        ),
        (
            lambda tree: set_action(tree, 1, 0),
            r"node 1 is no leaf: .* cut it first, or choose one of 2, 3, 5, 6",
        ),
        (
            lambda tree: set_action(tree, 2, "push lefft"),
            "unknown action 'push lefft'; did you mean 'push left'?",
        ),
        (
            lambda tree: set_action(tree, 2, "zzz"),
            "unknown action 'zzz'; there are 'push left', 'push right'",
        ),
        (lambda tree: set_action(tree, 2, 2), "an action must be from 0 to 1, got 2"),
        (lambda tree: set_threshold(tree, 2, 0.0), "node 2 is a leaf"),
        (lambda tree: set_threshold(tree, 0, np.nan), "a threshold must be finite in float32, got nan"),
        (lambda tree: set_threshold(tree, 0, 1e39), "a threshold must be finite in float32, got 1e\\+39"),
        (
            lambda tree: set_feature(tree, 0, "pole angel"),
            "unknown feature 'pole angel'; did you mean 'pole angle'",
        ),
        (lambda tree: set_feature(tree, 0, 4), "a feature must be from 0 to 3, got 4"),
    ],
)
def test_what_cannot_be_done_is_said(cartpole, edit: Any, message: str):
    with pytest.raises(ValueError, match=message):
        edit(cartpole)


@pytest.mark.parametrize(
    "edit",
    [
        lambda tree: cut(tree, 0.0),  # pyright: ignore
        lambda tree: cut(tree, True),
        lambda tree: set_threshold(tree, 0, "0.1"),  # pyright: ignore
        lambda tree: set_threshold(tree, 0, [0.1]),  # pyright: ignore
        lambda tree: set_action(tree, 2, 0.5),
        lambda tree: set_action(tree, 2, True),
        lambda tree: set_feature(tree, 0, 1.0),  # pyright: ignore
    ],
)
def test_what_is_of_another_kind_is_said(cartpole, edit: Any):
    with pytest.raises(TypeError, match=r"a whole number, got|a number, got"):
        edit(cartpole)


def test_continuous_actions_are_checked(pendulum):
    for action, message in [(2.5, "from"), (np.nan, "from"), ([1, 1], r"shape \[1\], got \[2\]")]:
        with pytest.raises(ValueError, match=message):
            set_action(pendulum, 1, action)
    with pytest.raises(TypeError, match="is numbers"):
        set_action(pendulum, 1, "left")
    several = random_tree(np.random.default_rng(0), ACTIONS["multi_discrete"], depth=1)
    for action, message in [
        ("on", "2 options"),
        (["on"], "2 options"),
        (["on", "up"], "option of 'steer' 'up'"),
    ]:
        with pytest.raises(ValueError, match=message):
            set_action(several, 1, action)


def test_trees_of_other_spaces_are_not_grafted(cartpole, pendulum, front):
    with pytest.raises(ValueError, match="must be of the same features"):
        graft(cartpole, 0, pendulum)
    renamed = random_tree(np.random.default_rng(0), DiscreteActions(3), depth=1)
    ours = random_tree(np.random.default_rng(0), ACTIONS["discrete"], depth=1)
    with pytest.raises(ValueError, match="must be of the same actions"):
        graft(ours, 0, renamed)
    noisy, quiet = (
        small([0], [0.0], [[0.0], [1.0]], actions=BoxActions(-1, 1, (1,), std=std)) for std in ((0.5,), None)
    )
    assert graft(noisy, 1, quiet).actions == noisy.actions


def test_names_of_strangers_are_found_and_shown_on_one_line():
    names = tuple(name or "empty" for name in HOSTILE_NAMES)
    tree = small(
        [0],
        [0.0],
        np.eye(len(names))[:2],
        actions=DiscreteActions(len(names), names),
        feature_names=names,
    )
    for i, name in enumerate(names):
        assert set_action(tree, 1, name).predict(np.zeros(len(names))) == i
        assert set_feature(tree, 0, name).feature[0] == i
    with pytest.raises(ValueError, match="unknown action") as caught:
        set_action(tree, 1, "line\nbreak?")
    assert "\n" not in str(caught.value)
    twice = small(
        [0],
        [0.0],
        np.eye(2),
        actions=DiscreteActions(2),
        feature_names=["a", "a"],
    )
    with pytest.raises(ValueError, match=r"2 of the names are 'a', as features \[0, 1\]: give its number"):
        set_feature(twice, 0, "a")


def test_one_component_of_many_may_have_one_option():
    actions = MultiDiscreteActions((1, 2))
    tree = small([], [], np.zeros((1, 3)), actions=actions, feature_names=["x"])
    np.testing.assert_array_equal(set_action(tree, 0, [0, 1]).predict([0.0]), [0, 1])
