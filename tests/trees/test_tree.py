import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, MultiDiscreteActions

from .samples import ACTIONS, plain_leaf, random_tree, telling_observations

STUMP = {
    "feature": np.array([0]),
    "threshold": np.array([0.5]),
    "leaf_values": np.array([[1.0, 0.0], [0.0, 1.0]]),
    "actions": DiscreteActions(2),
}


def test_importing_trees_imports_nothing_heavy():
    heavy = "{'jax', 'gymnasium', 'matplotlib', 'sklearn', 'scipy', 'equinox', 'optax'}"
    code = f"import sys, sympol.trees; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("kind", ACTIONS)
def test_prediction_is_the_plain_loop(kind):
    rng = np.random.default_rng(1)
    for _ in range(5):
        tree = random_tree(rng, ACTIONS[kind], depth=5)
        x = telling_observations(tree, rng, 1000)
        leaves = np.array([plain_leaf(tree, row) for row in x])
        assert (tree.apply(x) == leaves).all()
        assert (tree.predict(x) == tree.actions.decide(tree.value)[leaves]).all()
        assert (tree.predict(x[0]) == tree.predict(x)[0]).all()
        path = tree.decision_path(x)
        assert (path.sum(axis=1) == tree.node_depth[leaves] + 1).all()
        assert path[:, 0].all()
        assert path[np.arange(len(x)), leaves].all()
        assert (tree.decision_path(x[0]) == path[0]).all()


def test_a_complete_tree_is_read_breadth_first():
    tree = DecisionTree.from_complete(
        np.array([0, 1, 0]), np.array([0.0, 1.0, 2.0]), np.eye(4), actions=DiscreteActions(4)
    )
    assert tree.children_left.tolist() == [1, 2, -1, -1, 5, -1, -1]
    assert tree.children_right.tolist() == [4, 3, -1, -1, 6, -1, -1]
    assert tree.feature.tolist() == [0, 1, -2, -2, 0, -2, -2]
    assert tree.threshold.tolist() == [0, 1, -2, -2, 2, -2, -2]
    assert tree.predict([[-1, 0], [-1, 5], [1, 0], [3, 0]]).tolist() == [0, 1, 2, 3]
    assert (tree.n_nodes, tree.n_leaves, tree.depth, tree.n_features) == (7, 4, 2, 2)
    assert tree.feature_names == ("x[0]", "x[1]")


def test_a_tree_may_be_one_leaf():
    tree = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.array([[0.0, 1.0]]), actions=DiscreteActions(2), feature_names=["x"]
    )
    assert (tree.n_nodes, tree.depth) == (1, 0)
    assert tree.predict([[np.nan]]).tolist() == [1]
    assert tree.prune() == tree


def test_ties_nan_and_subnormals():
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([1e-40]), np.array([[1.0, 1.0], [1e-41, 2e-41]]), actions=DiscreteActions(2)
    )
    assert tree.threshold[0] == 0
    assert tree.apply([[0.0], [-0.0], [1e-39], [1.2e-38], [np.nan], [np.inf], [-np.inf]]).tolist() == [
        1,
        1,
        1,
        2,
        2,
        2,
        1,
    ]
    assert tree.predict([[0.0], [1.0]]).tolist() == [0, 0]


def test_an_observation_is_rounded_to_float32():
    tree = DecisionTree.from_complete(**{**STUMP, "threshold": np.array([0.1])})
    above = float(np.float32(0.1)) + 1e-12
    assert tree.predict([above]) == 0
    assert tree.predict([1e300]) == 1
    assert tree.predict([-(10**15)]) == 0
    assert tree.predict([True]) == 1


@pytest.mark.parametrize(
    ("observation", "error"),
    [
        ([1.0, 2.0], ValueError),
        ([[[1.0]]], ValueError),
        (1.0, ValueError),
        (["a"], TypeError),
        ([None], TypeError),
        ([1j], TypeError),
    ],
)
def test_bad_observations_are_refused(observation, error):
    with pytest.raises(error, match="observation"):
        DecisionTree.from_complete(**STUMP).predict(observation)


def test_equality_is_by_content():
    tree = DecisionTree.from_complete(**STUMP)
    assert tree == DecisionTree.from_complete(**STUMP)
    assert hash(tree) == hash(DecisionTree.from_complete(**STUMP))
    assert tree != DecisionTree.from_complete(**{**STUMP, "threshold": np.array([0.25])})
    assert tree != tree.with_visits([[0.0]])
    assert tree != dataclasses.replace(tree, meta={"env": "CartPole-v1"})
    assert tree != "a tree"


def test_a_tree_cannot_be_changed():
    threshold = np.array([0.5], np.float32)
    tree = DecisionTree.from_complete(**{**STUMP, "threshold": threshold})
    threshold[0] = 7
    assert tree.threshold[0] == 0.5
    with pytest.raises(ValueError, match="read-only"):
        tree.threshold[0] = 7
    with pytest.raises(dataclasses.FrozenInstanceError):
        tree.meta = {}


def test_visits_are_counted_at_every_node():
    tree = DecisionTree.from_complete(**STUMP).with_visits([[0.0], [0.1], [1.0]])
    assert tree.n_node_samples is not None
    assert tree.n_node_samples.tolist() == [3, 2, 1]


def test_probabilities():
    tree = DecisionTree.from_complete(**{**STUMP, "leaf_values": np.array([[0.0, np.log(3)], [1e30, -1e30]])})
    assert np.allclose(tree.predict_proba([[0.0], [1.0]]), [[0.25, 0.75], [1, 0]])
    assert np.allclose(tree.predict_proba([0.0]), [0.25, 0.75])
    multi = random_tree(np.random.default_rng(0), ACTIONS["multi_discrete"])
    gas, steer = multi.predict_proba(np.zeros((4, 3)))
    assert gas.shape == (4, 2)
    assert np.allclose(steer.sum(axis=1), 1)
    with pytest.raises(TypeError, match="continuous"):
        random_tree(np.random.default_rng(0), ACTIONS["box"]).predict_proba(np.zeros(3))


def test_deterministic_actions():
    discrete = DiscreteActions(3, start=5)
    assert discrete.decide(np.float32([[0, 1, 1], [2, 2, 2]])).tolist() == [6, 5]
    assert discrete.words(6) == ("action 6",)
    multi = MultiDiscreteActions((2, 3), ("gas", "steer"), start=(0, -1))
    assert multi.decide(np.float32([[0, 1, 5, 4, 5]])).tolist() == [[1, -1]]
    assert multi.words([1, -1]) == ("gas: 1", "steer: -1")
    box = BoxActions(-1, 1, (2, 1), ("gas", "steer"), std=(0.1, 0.2))
    action = box.decide(np.float32([[0.53, -7.0]]))[0]
    assert action.dtype == np.float32
    assert action.tolist() == [[np.float32(0.53)], [-1]]
    assert box.words(action) == ("gas = 0.53", "steer = -1")
    assert box.words(action, digits=1) == ("gas = 0.5", "steer = -1")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"children_right": [1, -1, -1]}, "preorder"),
        ({"children_left": [0, -1, -1]}, "preorder"),
        ({"children_left": [-1, -1, -1], "children_right": [-1, -1, -1]}, "preorder"),
        ({"children_left": [1, 2, -1], "children_right": [2, -1, -1]}, "preorder"),
        ({"feature": [3, -2, -2]}, r"feature must be in \[0, 1\)"),
        ({"feature": [0, 0, -2]}, "leaves must have feature"),
        ({"feature": [0, -2]}, "feature must|children_left must"),
        ({"threshold": [np.nan, -2, -2]}, "threshold must be finite"),
        ({"threshold": [1e39, -2, -2]}, "threshold must be finite"),
        ({"value": np.full((3, 2), np.inf)}, "value must be finite"),
        ({"value": np.ones((3, 2))}, "zero at inner nodes"),
        ({"value": np.zeros((3, 3))}, r"shape \(3, 2\)"),
        ({"feature_low": [1.0], "feature_high": [0.0]}, "feature_low must not exceed"),
        ({"feature_low": [np.nan]}, "feature_low must not exceed"),
        ({"feature_low": [0.0, 1.0]}, "feature_low must have shape"),
        ({"feature_names": (3,)}, "strings"),
        ({"n_node_samples": [3, 1, 1]}, "sum"),
        ({"n_node_samples": [0, 1, -1]}, "negative"),
        ({"meta": {"x": np.nan}}, "JSON"),
    ],
)
def test_what_is_no_tree_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(DecisionTree.from_complete(**STUMP), **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DiscreteActions(0), "at least one action"),
        (lambda: DiscreteActions(2, ("one",)), "2 names"),
        (lambda: MultiDiscreteActions(()), "at least one option"),
        (lambda: MultiDiscreteActions((2, 0)), "at least one option"),
        (lambda: MultiDiscreteActions((2, 2), start=(1,)), "2 components"),
        (lambda: MultiDiscreteActions((2,), options=(("a",),)), "2 names of options"),
        (lambda: BoxActions(1, -1, (1,)), "low must not exceed"),
        (lambda: BoxActions((0, 0, 0), 1, (2,)), "low has 3 numbers"),
        (lambda: BoxActions(0, 1, (0,)), "at least one number"),
        (lambda: BoxActions(0, 1, (1,), std=-1), "std"),
        (lambda: DecisionTree.from_complete(**{**STUMP, "leaf_values": np.zeros((3, 2))}), "complete tree"),
    ],
)
def test_bad_descriptions_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
