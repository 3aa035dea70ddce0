"""From scikit-learn's trees to ours: not one decision changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from sympol.distill import from_sklearn
from sympol.distill.cart import fit_cart
from sympol.envs.registry import resolve

from .teachers import CARTPOLE, chain

RNG = np.random.default_rng(0)
EYES = Box(-np.inf, np.inf, (3,))
SPACES = [
    Discrete(4),
    Discrete(3, start=-1),
    MultiDiscrete([2, 4, 3], start=[0, 1, -5]),
    MultiDiscrete([3]),
    Box(-1, 1, (1,)),
    Box(-1, 1, (2, 2)),
]


def batch(n: int) -> np.ndarray:
    """Numbers of all sizes, many of them equal."""
    x = RNG.normal(size=(n, 3)) * 10.0 ** RNG.integers(-6, 6, (n, 3))
    x[::3] = RNG.integers(-2, 3, x[::3].shape)
    return x.astype(np.float32)


def around(estimator: Any) -> np.ndarray:
    """The float32 numbers on and beside every threshold."""
    thresholds = estimator.tree_.threshold[estimator.tree_.feature >= 0].astype(np.float32)
    ends = [np.nextafter(thresholds, np.float32(end)) for end in (-np.inf, np.inf)]
    return RNG.choice(np.concatenate([thresholds, *ends, [0]]), (4000, 3))


@pytest.mark.parametrize("options", [{"max_depth": 6}, {"max_leaf_nodes": 40}, {"max_depth": 1}], ids=str)
@pytest.mark.parametrize("space", SPACES, ids=str)
def test_ours_acts_as_scikit_learns_does(space: Any, options: dict[str, Any]):
    space.seed(0)
    spec, x = chain(EYES, space), batch(600)
    y = np.stack([space.sample() for _ in x]).reshape(len(x), -1)
    y[: len(y) // 2] = y[0]  # some sense in it
    kind = DecisionTreeRegressor if isinstance(space, Box) else DecisionTreeClassifier
    estimator = kind(random_state=0, **options).fit(x, y)
    tree = from_sklearn(estimator, spec)
    tried = np.concatenate([batch(20_000), around(estimator)])
    np.testing.assert_array_equal(
        tree.predict(tried).reshape(len(tried), -1),
        estimator.predict(tried).reshape(len(tried), -1).astype(tree.predict(tried).dtype),
    )
    np.testing.assert_array_equal(tree.n_node_samples[0], len(x))  # pyright: ignore
    again = from_sklearn(tree.to_sklearn(), spec)
    np.testing.assert_array_equal(again.predict(tried), tree.predict(tried))


@pytest.mark.parametrize("classes", [[1], [0, 3], [2, 3], [3]], ids=str)
def test_actions_that_no_sample_has_are_never_taken(classes: list[int]):
    x = batch(200)
    estimator = DecisionTreeClassifier(max_depth=3, random_state=0).fit(x, RNG.choice(classes, len(x)))
    tree = from_sklearn(estimator, chain(EYES, Discrete(4)))
    tried = batch(5000)
    np.testing.assert_array_equal(tree.predict(tried), estimator.predict(tried))
    assert set(tree.predict(tried)) <= {*classes}
    absent = [action for action in range(4) if action not in classes]
    assert tree.predict_proba(tried)[:, absent].max() < 1e-8  # pyright: ignore


def test_ties_go_to_the_lowest_action_and_near_ties_to_the_larger():
    x = np.zeros((6, 3), np.float32)
    spec = chain(EYES, Discrete(3))
    tie = DecisionTreeClassifier().fit(x, [2, 2, 1, 1, 0, 0])
    assert from_sklearn(tie, spec).predict(x[0]) == tie.predict(x[:1])[0] == 0
    weights = [1.0, 1.0, np.nextafter(1.0, 2.0)]  # equal in float32, and their logarithms too
    near = DecisionTreeClassifier().fit(x[:3], [0, 1, 2], sample_weight=weights)
    assert from_sklearn(near, spec).predict(x[0]) == near.predict(x[:1])[0] == 2


def test_leaves_hold_the_shares_of_their_samples():
    x = np.array([[0, 0, 0]] * 4 + [[1, 0, 0]] * 2, np.float32)
    tree = from_sklearn(
        DecisionTreeClassifier(max_depth=1).fit(x, [0, 0, 0, 1, 1, 1]), chain(EYES, Discrete(2))
    )
    np.testing.assert_allclose(tree.predict_proba(x[[0, 5]]), [[0.75, 0.25], [0, 1]], atol=1e-8)  # pyright: ignore
    np.testing.assert_array_equal(tree.n_node_samples, [6, 4, 2])  # pyright: ignore


def test_the_tree_speaks_of_the_environment():
    named = resolve("CartPole-v1", backend="host", action_names=["links", "rechts"])
    x = RNG.normal(size=(50, 4)).astype(np.float32) * 0.1
    tree = fit_cart(x, RNG.integers(0, 2, 50), named, depth=3, seed=0)
    assert tree.feature_names == named.features.names
    assert tree.feature_names[0] == "cart position (m)"
    assert tree.actions.names == ("links", "rechts")
    np.testing.assert_array_equal(tree.feature_low, named.features.low)
    assert tree.depth <= 3


@pytest.mark.parametrize("max_nodes", [3, 5, 15, 31])
def test_a_limit_of_nodes_is_spent_where_it_gains_most(max_nodes: int):
    """Best-first: of all trees with one split more, CART's next is that of the greatest gain in impurity."""
    x = RNG.normal(size=(400, 4)).astype(np.float32)
    x[:, 0] = np.abs(x[:, 0])
    y = ((x[:, 0] > 0.3) * (np.floor(8 * x[:, 0]) % 2)).astype(
        int
    )  # stripes on one side: a deep, narrow tree
    tree = fit_cart(x, y, CARTPOLE, depth=None, max_nodes=max_nodes, seed=0)
    whole = fit_cart(x, y, CARTPOLE, depth=None, seed=0)
    assert tree.n_nodes == max_nodes
    assert _impurity(tree, x, y) == pytest.approx(_greedy(whole, x, y, max_nodes), abs=1e-9)
    both = fit_cart(x, y, CARTPOLE, depth=2, max_nodes=max_nodes, seed=0)
    assert both.depth <= 2
    assert both.n_nodes <= max_nodes


def _impurity(tree: Any, x: np.ndarray, y: np.ndarray) -> float:
    """Gini, summed over leaves by their weight."""
    leaf = tree.apply(x)
    return sum(_gini(y[leaf == each]) for each in np.unique(leaf))


def _gini(y: np.ndarray) -> float:
    return len(y) * (1 - sum((y == each).mean() ** 2 for each in np.unique(y))) if len(y) else 0.0


def _greedy(whole: Any, x: np.ndarray, y: np.ndarray, max_nodes: int) -> float:
    """Open the whole tree split by split, always the one that lowers the impurity most."""
    comes_by = whole.decision_path(x)

    def gain(node: int) -> float:
        if whole.is_leaf[node]:
            return -1.0
        children = whole.children_left[node], whole.children_right[node]
        return _gini(y[comes_by[:, node]]) - sum(_gini(y[comes_by[:, child]]) for child in children)

    open_nodes, nodes = {0}, 1
    while nodes < max_nodes:
        best = max(open_nodes, key=gain)
        open_nodes = open_nodes - {best} | {int(whole.children_left[best]), int(whole.children_right[best])}
        nodes += 2
    return sum(_gini(y[comes_by[:, node]]) for node in open_nodes)


def test_bounds_that_the_environment_broke_are_not_believed():
    x = np.array([[0, 0, 0, 0], [9, 0, -9, 0]], np.float32)
    tree = fit_cart(x, np.array([0, 1]), CARTPOLE, depth=1, seed=0)
    low, high = CARTPOLE.features.low, CARTPOLE.features.high
    assert (tree.feature_high[0], tree.feature_low[2]) == (np.inf, -np.inf)
    assert (tree.feature_low[0], tree.feature_high[2]) == (low[0], high[2])


def test_another_seed_may_give_another_tree_and_the_same_gives_the_same():
    x = np.tile(RNG.integers(0, 2, (60, 1)), (1, 4)).astype(np.float32)  # four features that say the same
    trees = [fit_cart(x, x[:, 0].astype(int), CARTPOLE, depth=1, seed=seed) for seed in [*range(8), 0]]
    assert trees[0] == trees[-1]
    assert len({*trees}) > 1


@pytest.mark.parametrize(
    ("space", "estimator", "message"),
    [
        (Discrete(2), DecisionTreeRegressor(), "must be a classifier with 1 output, got a DecisionTreeRegressor"),
        (Box(-1, 1, (1,)), DecisionTreeClassifier(), "must be a regressor"),
        (MultiDiscrete([2, 2]), DecisionTreeClassifier(), "must be a classifier with 2 outputs, got a .* with 1"),
        (Discrete(2, start=1), DecisionTreeClassifier(), r"classes must be actions, from 1 to 2, got \[0, 1\]"),
    ],
)  # fmt: skip
def test_a_tree_for_other_actions_is_refused(space: Any, estimator: Any, message: str):
    with pytest.raises(ValueError, match=message):
        from_sklearn(estimator.fit(np.eye(3, dtype=np.float32), [0, 1, 1]), chain(EYES, space))


def test_a_tree_of_other_features_and_observations_that_are_not_finite_are_refused():
    estimator = DecisionTreeClassifier().fit(np.eye(2), [0, 1])
    with pytest.raises(ValueError, match="must see 4 features, got one fitted on 2"):
        from_sklearn(estimator, CARTPOLE)
    x = np.array([[0, 0, 0, 0], [np.nan, 0, 0, 0]], np.float32)
    with pytest.raises(ValueError, match=r"CartPole-v1 returned the observation \[nan, .* not finite"):
        fit_cart(x, np.array([0, 1]), CARTPOLE, depth=1, seed=0)


@pytest.mark.parametrize("unit", [1e-4, 1e-7, 1e-30])
def test_the_unit_of_a_feature_does_not_matter(unit: float):
    x = RNG.uniform(-1, 1, (500, 3)).astype(np.float32)
    tiny = x * np.array([1, unit, 1], np.float32)
    y = (x[:, 1] > 0.2).astype(int)
    tree = fit_cart(tiny, y, chain(EYES, Discrete(2)), depth=2, seed=0)
    np.testing.assert_array_equal(tree.predict(tiny), y)
    assert tree.feature[0] == 1
    np.testing.assert_allclose(tree.threshold[0] / np.float32(unit), 0.2, atol=0.02)
