"""Random changes: every one is a tree, asks what makes a difference, and leaves the rest alone."""

from __future__ import annotations

import numpy as np
import pytest

from sympol.search.mutations import (
    Leaf,
    Mutator,
    Split,
    from_nested,
    nodes_with_paths,
    num_nodes,
    replace_at,
    to_nested,
)
from sympol.trees import DecisionTree
from sympol.trees.actions import BoxActions, DiscreteActions, MultiDiscreteActions

KINDS = {
    "discrete": DiscreteActions(3, start=2),
    "multi": MultiDiscreteActions((2, 3)),
    "box": BoxActions(low=(-2.0, 0.0), high=(2.0, np.inf), shape=(2,)),
}


def complete(actions, depth=3, seed=0):
    rng = np.random.default_rng(seed)
    return DecisionTree.from_complete(
        rng.integers(0, 4, 2**depth - 1),
        rng.normal(size=2**depth - 1),
        rng.normal(size=(2**depth, actions.n_outputs)),
        actions=actions,
        feature_names=("a", "b", "c", "d"),
    )


def seen(seed=0):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(500, 4)).astype(np.float32)
    x[:, 2] = rng.integers(0, 2, 500)  # a feature of two values
    x[:, 3] = 7  # and one that never changes
    return x


@pytest.mark.parametrize("actions", KINDS.values(), ids=KINDS)
def test_there_and_back_is_the_same_tree(actions):
    tree = complete(actions)
    assert from_nested(to_nested(tree), tree) == tree
    assert num_nodes(to_nested(tree)) == tree.n_nodes


def test_the_nested_tree_answers_as_the_tree_does():
    tree = complete(KINDS["discrete"])

    def answer(node, x):
        while isinstance(node, Split):
            node = node.left if x[node.feature] <= np.float32(node.threshold) else node.right
        return node.value

    for x in seen():
        np.testing.assert_array_equal(np.float32(answer(to_nested(tree), x)), tree.value[tree.apply(x)])


def test_a_path_leads_where_a_subtree_is_put():
    root = to_nested(complete(KINDS["discrete"]))
    new = Leaf((9.0, 9.0, 9.0))
    for path, _ in nodes_with_paths(root):
        changed = replace_at(root, path, new)
        assert dict(nodes_with_paths(changed))[path] is new
        others = {p: n for p, n in nodes_with_paths(root) if p[: len(path)] != path and path[: len(p)] != p}
        assert all(dict(nodes_with_paths(changed))[p] is n for p, n in others.items())


@pytest.mark.parametrize("actions", KINDS.values(), ids=KINDS)
def test_every_change_is_a_tree_that_asks_what_differs(actions):
    rng, mutator, like = (
        np.random.default_rng(1),
        Mutator.for_observations(actions, seen()),
        complete(actions),
    )
    node, sizes = to_nested(like), set()
    for _ in range(400):
        node = mutator.mutate(node, [to_nested(like)], rng)
        if num_nodes(node) > 41:
            node = mutator.random_leaf(rng)
        sizes.add(num_nodes(node))
        tree = from_nested(node, like)  # checks that it is one
        assert len(tree.predict(seen()[:5])) == 5
    assert {1, 3, 5, 7} <= sizes  # they grow and shrink


def test_a_question_lies_between_two_values_that_were_seen():
    rng, mutator = np.random.default_rng(2), Mutator.for_observations(KINDS["discrete"], seen())
    asked = set()
    for _ in range(300):
        node = mutator.mutate(Leaf((0.0, 0.0, 0.0)), [Leaf((1.0, 0.0, 0.0))], rng)
        for _, split in nodes_with_paths(node):
            if isinstance(split, Split):
                asked.add(split.feature)
                if split.feature == 2:
                    assert split.threshold == 0.5
    assert asked == {0, 1, 2}  # never of the feature that is always the same


def test_continuous_answers_stay_within_the_bounds():
    rng, mutator = np.random.default_rng(3), Mutator.for_observations(KINDS["box"], seen())
    node = mutator.random_leaf(rng)
    for _ in range(300):
        node = mutator.mutate(node, [node], rng)
        if num_nodes(node) > 21:
            node = mutator.random_leaf(rng)
        for _, leaf in nodes_with_paths(node):
            if isinstance(leaf, Leaf):
                assert -2 <= leaf.value[0] <= 2
                assert leaf.value[1] >= 0


def test_the_same_generator_draws_the_same_changes():
    mutator, root = (
        Mutator.for_observations(KINDS["discrete"], seen()),
        to_nested(complete(KINDS["discrete"])),
    )
    one, other = (mutator.mutate(root, [root], np.random.default_rng(5)) for _ in range(2))
    assert one == other


def test_where_nothing_differs_there_is_nothing_to_ask():
    with pytest.raises(ValueError, match="5 observations are all the same"):
        Mutator.for_observations(KINDS["discrete"], np.ones((5, 4), np.float32))


def test_where_there_is_one_gap_another_question_is_asked():
    rng, mutator = np.random.default_rng(5), Mutator.for_observations(KINDS["discrete"], seen())
    root = Split(2, 0.5, Leaf((1.0, 0.0, 0.0)), Leaf((0.0, 1.0, 0.0)))
    changed = [mutator.mutate(root, [root], rng) for _ in range(400)]
    # the same question may be drawn again, and a subtree may take its own place
    assert sum(node == root for node in changed) < 60
    assert {node.feature for node in changed if isinstance(node, Split)} == {0, 1, 2}
