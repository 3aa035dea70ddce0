"""Trees of scikit-learn's, without an environment; tests/distill/test_cart.py has them with one."""

import dataclasses
import re
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


def test_classes_that_are_the_actions_names_are_matched_by_name():
    x = np.array([[0.0], [1.0], [2.0]])
    for start in (0, 5):
        actions = DiscreteActions(4, ("stay", "go", "jump", "never"), start=start)
        for kind in (str, object):
            estimator = DecisionTreeClassifier().fit(x, np.array(["stay", "jump", "go"], kind))
            tree = DecisionTree.from_sklearn(estimator, actions)
            assert [actions.names[i - start] for i in tree.predict(x)] == estimator.predict(x).tolist()
    several = MultiDiscreteActions((2, 3), ("gas", "steer"), (("off", "on"), ("left", "none", "right")))
    answers = np.array([["on", "left"], ["off", "right"], ["on", "none"]])
    estimator = DecisionTreeClassifier().fit(x, answers)
    assert DecisionTree.from_sklearn(estimator, several).predict(x).tolist() == [[1, 0], [0, 2], [1, 1]]


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        (["0", "1"], r"from 0 to 1, got \['0', '1'\]; by name there are 'stay', 'go'"),
        (["stay", "fly"], r"from 0 to 1, got \['fly', 'stay'\]; by name"),
        ([0.5, 1.0], r"from 0 to 1, got \[0.5, 1.0\]"),
        ([-1, 0], r"from 0 to 1, got \[-1, 0\]"),
    ],
)
def test_classes_that_are_no_actions_are_said(classes: list[Any], message: str):
    estimator = DecisionTreeClassifier().fit([[0], [1]], [0, 1])
    estimator.classes_ = np.sort(np.array(classes))
    with pytest.raises(ValueError, match=f"the classes must be actions, {message}"):
        DecisionTree.from_sklearn(estimator, DiscreteActions(2, ("stay", "go")))


def test_a_name_of_two_actions_is_no_class():
    estimator = DecisionTreeClassifier().fit([[0], [1]], ["go", "stay"])
    with pytest.raises(ValueError, match="the classes must be actions"):
        DecisionTree.from_sklearn(estimator, DiscreteActions(3, ("go", "go", "stay")))


def looks_as_if_nothing_was_missing(estimator: Any) -> bool:
    """What scikit-learn writes of missing values where there were none: they would go where more samples went."""
    grown, inner = estimator.tree_, estimator.tree_.children_left >= 0
    left, right = (grown.n_node_samples[side[inner]] for side in (grown.children_left, grown.children_right))
    return bool(
        np.isfinite(grown.threshold).all() and (grown.missing_go_to_left[inner] == (left > right)).all()
    )


@pytest.mark.parametrize("splitter", ["best", "random"])
def test_missing_values_are_answered_alike_or_refused(splitter: Any):
    outcomes = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = np.round(rng.normal(size=(60, 2)), 1)
        missing = rng.random(x.shape) < 0.2
        y = np.where(missing[:, 0] & (seed % 2 == 0), 1, (x[:, 0] > 0.3) ^ (x[:, 1] > 0)).astype(int)
        x[missing] = np.nan
        estimator = DecisionTreeClassifier(max_depth=1 + seed % 4, splitter=splitter, random_state=seed).fit(
            x, y
        )
        if looks_as_if_nothing_was_missing(estimator):
            outcomes.append("unknown")
            continue
        try:
            tree = DecisionTree.from_sklearn(estimator, DiscreteActions(2), feature_names=["a", "b"])
        except ValueError as error:
            outcomes.append(str(error))
        else:
            outcomes.append("converted")
            assert (tree.predict(x) == estimator.predict(x)).all()
    refused = {one for one in outcomes if one not in ("unknown", "converted")}
    pattern = (
        r"node \d+ of the estimator sends missing values of '[ab]' left, .*: fill missing values in, and .*"
    )
    assert all(re.fullmatch(pattern, said) for said in refused)
    assert len(refused) > 3
    assert "converted" in outcomes


def test_a_split_of_missing_values_from_numbers_is_converted_exactly():
    x = np.array([[np.nan], [np.nan], [1.0], [-5.0], [3e38], [-3e38]])
    estimator = DecisionTreeClassifier().fit(x, [1, 1, 0, 0, 0, 0])
    assert np.isinf(estimator.tree_.threshold[0])
    tree = DecisionTree.from_sklearn(estimator, DiscreteActions(2))
    assert tree.n_nodes == 3
    assert (tree.predict(x) == estimator.predict(x)).all()
    largest = np.finfo(np.float32).max
    assert tree.predict([[largest], [-largest], [np.nan]]).tolist() == [0, 0, 1]
    assert DecisionTree.from_json(tree.to_json()) == tree


def test_other_infinite_thresholds_are_refused_by_name():
    estimator = DecisionTreeClassifier().fit([[0.0], [1.0]], [0, 1])
    state = estimator.tree_.__getstate__()
    state["nodes"]["threshold"][0] = -np.inf
    estimator.tree_.__setstate__(state)
    with pytest.raises(
        ValueError, match="node 0 of the estimator has the threshold -inf, which is none in float32"
    ):
        DecisionTree.from_sklearn(estimator, DiscreteActions(2))


def test_trees_that_never_saw_missing_values_are_as_they_were():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        estimator = DecisionTreeClassifier(max_depth=5, random_state=seed).fit(
            rng.normal(size=(80, 3)), rng.integers(0, 2, 80)
        )
        assert DecisionTree.from_sklearn(estimator, DiscreteActions(2)).n_nodes == estimator.tree_.node_count


def grown(actions: Any, seed: int) -> tuple[Any, DecisionTree, np.ndarray]:
    """An estimator, what is made of it and of its samples."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(200, 3)).astype(np.float32)
    if isinstance(actions, BoxActions):
        estimator: Any = DecisionTreeRegressor(max_depth=4, random_state=0).fit(
            x, rng.uniform(-0.4, 0.4, (200, 2))
        )
    elif isinstance(actions, MultiDiscreteActions):
        estimator = DecisionTreeClassifier(max_depth=4, random_state=0).fit(
            x, rng.integers(0, (2, 3), (200, 2))
        )
    else:
        estimator = DecisionTreeClassifier(max_depth=4, random_state=0).fit(x, rng.integers(-1, 2, 200))
    return estimator, DecisionTree.from_sklearn(estimator, actions), x


@pytest.mark.parametrize("kind", ACTIONS)
def test_estimators_have_samples_that_add_up_impurities_and_importances(kind: str):
    for tree in (grown(ACTIONS[kind], 0)[1], random_tree(np.random.default_rng(0), ACTIONS[kind])):
        for one in (tree, dataclasses.replace(tree, n_node_samples=None), tree.with_visits(np.zeros((0, 3)))):
            made = one.to_sklearn().tree_
            inner = made.children_left >= 0
            left, right = made.children_left[inner], made.children_right[inner]
            assert (
                made.n_node_samples[inner] == made.n_node_samples[left] + made.n_node_samples[right]
            ).all()
            assert made.n_node_samples[0] > 0
            assert (made.weighted_n_node_samples == made.n_node_samples).all()
            assert (made.impurity >= 0).all()
            importances = one.to_sklearn().feature_importances_
            assert importances.sum() == pytest.approx(1)
            assert (importances >= 0).all()
            assert (importances[np.setdiff1d(np.arange(3), tree.feature)] == 0).all()


def test_a_classifier_there_and_back_has_its_impurities_and_importances():
    """Leaves keep their shares, so all above them follows; a regressor's leaves keep only their means."""
    for kind in ("discrete", "multi_discrete"):
        estimator, tree, _ = grown(ACTIONS[kind], 1)
        back = tree.to_sklearn()
        order = np.argsort(-estimator.tree_.n_node_samples, kind="stable")
        again = np.argsort(-back.tree_.n_node_samples, kind="stable")
        np.testing.assert_allclose(
            np.sort(back.tree_.impurity[again]), np.sort(estimator.tree_.impurity[order]), atol=1e-6
        )
        np.testing.assert_allclose(back.feature_importances_, estimator.feature_importances_, atol=1e-6)


def test_estimators_have_the_features_names():
    estimator, tree, x = grown(ACTIONS["discrete"], 2)
    assert not hasattr(tree.to_sklearn(), "feature_names_in_")  # x[0], x[1], ... are no names
    named = dataclasses.replace(tree, feature_names=("a", "b", "a"))
    assert named.to_sklearn().feature_names_in_.tolist() == ["a", "b", "a"]
    assert DecisionTree.from_sklearn(named.to_sklearn(), tree.actions).feature_names == ("a", "b", "a")
    plain = named.to_sklearn(names=False)
    assert not hasattr(plain, "feature_names_in_")
    assert (plain.predict(x) == estimator.predict(x)).all()  # without a warning
