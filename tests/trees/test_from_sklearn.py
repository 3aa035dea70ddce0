"""Trees of scikit-learn's, without an environment; tests/distill/test_cart.py has them with one."""

from typing import Any

import numpy as np
import pytest
from sklearn.ensemble import RandomForestClassifier
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.floats import SMALLEST_NORMAL
from sympol.trees.from_sklearn import rounded_down

from .samples import ACTIONS, consistent, random_grouped_tree, random_tree, telling_observations

RNG = np.random.default_rng(0)


def fitted(actions: Any, **options: Any) -> tuple[Any, np.ndarray]:
    """An estimator, and the observations on and beside its thresholds."""
    x = np.round(RNG.normal(size=(300, 3)), 1).astype(np.float32)
    if isinstance(actions, BoxActions):
        estimator: Any = DecisionTreeRegressor(random_state=0, **options).fit(x, RNG.normal(size=(300, 2)))
    elif isinstance(actions, MultiDiscreteActions):
        estimator = DecisionTreeClassifier(random_state=0, **options).fit(
            x, RNG.integers(0, (2, 3), (300, 2))
        )
    else:
        estimator = DecisionTreeClassifier(random_state=0, **options).fit(x, RNG.integers(-1, 2, 300))
    t = estimator.tree_.threshold[estimator.tree_.feature >= 0].astype(np.float32)
    return estimator, RNG.choice(
        np.concatenate([t, np.nextafter(t, np.float32(9)), np.nextafter(t, -9), [0]]), (2000, 3)
    )


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("options", [{"max_depth": 5}, {"max_leaf_nodes": 30}], ids=str)
def test_not_one_decision_changes(kind: str, options: dict[str, Any]):
    estimator, x = fitted(ACTIONS[kind], **options)
    tree = DecisionTree.from_sklearn(estimator, ACTIONS[kind])
    expected = estimator.predict(x).reshape(len(x), -1)
    if kind == "box":
        expected = np.clip(expected.astype(np.float32), ACTIONS[kind].low, ACTIONS[kind].high)  # pyright: ignore
    np.testing.assert_array_equal(tree.predict(x).reshape(len(x), -1), expected.astype(tree.predict(x).dtype))
    assert tree.feature_names == ("x[0]", "x[1]", "x[2]")


@pytest.mark.parametrize("kind", ACTIONS)
def test_there_and_back_is_the_same_tree(kind: str):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        for tree in (random_tree(rng, ACTIONS[kind]), random_grouped_tree(rng, ACTIONS[kind])):
            again = DecisionTree.from_sklearn(
                tree.to_sklearn(),
                tree.actions,
                feature_names=tree.feature_names,
                feature_low=tree.feature_low,
                feature_high=tree.feature_high,
                groups=tree.groups,
            )
            x = telling_observations(tree, rng, 2000)
            for group in tree.groups:
                x[:, group.features] = np.eye(len(group.features))[
                    rng.integers(len(group.features), size=len(x))
                ]
            assert len(consistent(tree, x)) == len(x)
            np.testing.assert_array_equal(again.predict(x), tree.predict(x))
            np.testing.assert_array_equal(again.n_node_samples, tree.n_node_samples)  # pyright: ignore
            assert again.groups == tree.groups


def test_names_are_given_or_the_estimators_own():
    estimator = DecisionTreeClassifier().fit(np.eye(2), [0, 1])
    estimator.feature_names_in_ = np.array(["'); DROP TABLE", "b"], object)
    actions = DiscreteActions(2)
    assert DecisionTree.from_sklearn(estimator, actions).feature_names == ("'); DROP TABLE", "b")
    named = DecisionTree.from_sklearn(
        estimator, actions, feature_names=["c", "d"], groups=[Group("g", (0, 1), ("p", "q"))]
    )
    assert named.feature_names == ("c", "d")
    assert "g is " in named.to_text()


def test_thresholds_are_rounded_down_to_what_decides_alike():
    down = rounded_down(np.array([0.1, 1 / 3, -0.1, 0.5, 1e-40, -1e-40, 0.0, 1e39]))
    assert down.dtype == np.float32
    assert (down[:4].astype(float) <= [0.1, 1 / 3, -0.1, 0.5]).all()
    assert down[3:].tolist() == [0.5, 0, -SMALLEST_NORMAL, 0, np.finfo(np.float32).max]
    edges = np.array([0, SMALLEST_NORMAL, -SMALLEST_NORMAL], np.float32)
    for t in (1e-40, -1e-40, 0.0, SMALLEST_NORMAL / 2, -SMALLEST_NORMAL / 2):
        assert (edges <= rounded_down(np.array([t]))[0]).tolist() == (edges.astype(float) <= t).tolist()


@pytest.mark.parametrize(
    ("estimator", "space", "message"),
    [
        (DecisionTreeClassifier(), {}, "no single fitted tree; fit it first"),
        (RandomForestClassifier(n_estimators=2).fit(np.eye(2), [0, 1]), {}, "no single fitted tree"),
        (
            DecisionTreeClassifier().fit(np.eye(2), [0, 1]),
            {"feature_names": ["a"]},
            "1 features were named, .* fitted on 2",
        ),
        (
            DecisionTreeClassifier().fit(np.eye(2), [0, 2]),
            {},
            r"classes must be actions, from 0 to 1, got \[0, 2\]",
        ),
        (DecisionTreeRegressor().fit(np.eye(2), [0, 1]), {}, "must be a classifier"),
        (
            DecisionTreeClassifier().fit(np.eye(2), [0, 1]),
            {"feature_low": [0]},
            "feature_low must have shape",
        ),
    ],
)
def test_what_does_not_fit_is_said(estimator: Any, space: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=message):
        DecisionTree.from_sklearn(estimator, DiscreteActions(2), **space)


def test_what_is_no_tree_is_said():
    with pytest.raises(
        TypeError, match="expected a DecisionTreeClassifier or DecisionTreeRegressor, got a str"
    ):
        DecisionTree.from_sklearn("tree", DiscreteActions(2))  # pyright: ignore
