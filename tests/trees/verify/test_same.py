"""Whether two trees act the same, and the smallest observation on which they do not."""

import dataclasses

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.verify import equal

from ..samples import ACTIONS, random_grouped_tree, random_tree
from .questions import every_kind_of_observation


def test_the_counterexample_of_two_trees_is_the_smallest():
    rng = np.random.default_rng(5)
    sizes = []
    for _ in range(60):
        tree = random_tree(rng, ACTIONS["discrete"], depth=2)
        value = tree.value.copy()
        value[rng.choice(np.flatnonzero(tree.is_leaf))] *= -1
        other = dataclasses.replace(tree, value=value)
        x = every_kind_of_observation(tree)
        x = x[((x >= tree.feature_low) & (x <= tree.feature_high)).all(axis=1)]
        differ = x[tree.predict(x) != other.predict(x)]
        verdict = equal(tree, other)
        assert verdict.holds == (len(differ) == 0)
        if not verdict.holds:
            found = verdict.counterexample
            assert found is not None
            assert tree.predict(found) != other.predict(found)
            assert np.count_nonzero(found) == np.count_nonzero(differ, axis=1).min()
            sizes.append(np.count_nonzero(found))
    assert len(set(sizes)) > 2


def test_fewer_numbers_that_are_not_0_count_more_than_how_near_they_are():
    arrays = {
        "children_left": [1, 2, -1, 4, -1, -1, -1],
        "children_right": [6, 3, -1, 5, -1, -1, -1],
        "feature": [0, 1, -2, 2, -2, -2, -2],
        "threshold": [4.5, 0.05, -2, 0.05, -2, -2, -2],
        "actions": DiscreteActions(2),
        "feature_names": ("x", "y", "z"),
        "feature_low": [-9] * 3,
        "feature_high": [9] * 3,
    }
    first, last = [0, 0, 1, 0, 1, 0, 0], [0, 0, 1, 0, 1, 1, 1]
    tree, other = (
        DecisionTree(**arrays, value=np.column_stack([one, np.multiply(2, one)])) for one in (first, last)
    )
    assert tree.predict([0, 0.06, 0.06]) != other.predict([0, 0.06, 0.06])
    assert equal(tree, other).counterexample.tolist() == [5, 0, 0]  # pyright: ignore


def test_trees_are_equal_that_differ_only_between_whole_numbers():
    tree = DecisionTree.from_complete(
        np.array([0, 0, 0]),
        np.array([0.8, 0.2, 2]),
        np.eye(4),
        actions=DiscreteActions(4),
        feature_names=["x"],
    )
    value = tree.value.copy()
    value[np.flatnonzero(tree.is_leaf)[1]] *= 0  # of x from 0.2 to 0.8
    other = dataclasses.replace(tree, value=value)
    assert not equal(tree, other).holds
    whole = dataclasses.replace(tree, integers=[0])
    assert equal(whole, other).holds
    assert equal(other, whole).holds


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("make", [random_tree, random_grouped_tree])
def test_a_pruned_tree_is_equal_and_a_changed_one_is_not(kind, make):
    rng = np.random.default_rng(6)
    for depth in (0, 1, 4, 7):
        tree = make(rng, ACTIONS[kind], depth=depth)
        assert equal(tree, tree.prune()).holds
        assert equal(tree, tree.prune(bounds=False), within_bounds=False).holds
        small = tree.prune(merge=False)
        leaf = int(np.flatnonzero(small.is_leaf)[-1])
        value = small.value.copy()
        value[leaf] = -10 * np.sign(value[leaf]) if kind == "box" else -value[leaf]
        changed = dataclasses.replace(small, value=value)
        verdict = equal(tree, changed)
        assert not verdict.holds
        assert verdict.n_violating >= 1
        found = verdict.counterexample
        assert (tree.predict(found) != changed.predict(found)).any()
        assert "; the other: " in verdict.words


def test_trees_that_cannot_be_compared_are_refused(cartpole, pendulum, front):
    with pytest.raises(ValueError, match="other features: 'cart position' and 'cos θ'"):
        equal(cartpole, pendulum)
    with pytest.raises(ValueError, match="2 actions from number 0 and 2 actions from number 1"):
        equal(cartpole, dataclasses.replace(cartpole, actions=DiscreteActions(2, start=1)))
    group = dataclasses.replace(front.groups[0], name="elsewhere")
    with pytest.raises(ValueError, match="other groups"):
        equal(front, dataclasses.replace(front, groups=[group]))
    assert equal(front, dataclasses.replace(front, groups=())).holds
