"""Margins against brute force over every cell; noise against trying it."""

import dataclasses
from itertools import product

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.boxes import space
from sympol.trees.floats import next_above
from sympol.trees.verify import margin, noise

from ..samples import ACTIONS, consistent, random_grouped_tree, random_tree

SCALES = [1.0, np.array([0.5, 2, 0]), np.array([3, 0.1, 1])]


def candidates(tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    """The nearest observation of each cell is one of these: as near to x as the cell's ends allow."""
    axes = []
    for f in range(tree.n_features):
        if f in tree.group_of:
            axes.append(np.float32([0, 1]))
            continue
        cuts = tree.threshold[tree.feature == f]
        ends = np.concatenate([cuts, next_above(cuts), [x[f], tree.feature_low[f], tree.feature_high[f]]])
        if f in tree.integers:
            whole = np.concatenate([np.floor(ends), np.ceil(ends)])
            ends = whole[np.isfinite(whole)] + np.float32(0)
        axes.append(np.unique(ends[np.isfinite(ends)]))
    return consistent(tree, np.array(list(product(*axes)), np.float32))


def acts(tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    return np.reshape(tree.predict(x), (len(x), -1))


def nearest_by_trying(tree, x, scale, *, categories, within_bounds) -> float:
    y = candidates(tree, x)
    y = y[space(tree, bounds=within_bounds).contains(y)[0]]
    y = y[(acts(tree, y) != acts(tree, x[None])).any(axis=1)] if len(y) else y
    distance = np.abs(y.astype(float) - x)
    unit = np.broadcast_to(scale, x.shape)
    with np.errstate(divide="ignore", invalid="ignore"):
        units = np.where(distance > 0, distance / unit, 0)
    for group in tree.groups:
        of_group = list(group.features)
        changed = (y[:, of_group] != x[of_group]).any(axis=1, keepdims=True)
        units[:, of_group] = np.where(changed, np.inf if categories == "fixed" else 0, 0)
    return units.max(axis=1).min(initial=np.inf)


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("within_bounds", [False, True])
@pytest.mark.parametrize("scale", SCALES, ids=str)
def test_the_margin_is_the_distance_to_the_nearest_other_action(kind, within_bounds, scale):
    rng = np.random.default_rng(1)
    finite = 0
    for _ in range(6):
        tree = random_tree(rng, ACTIONS[kind], depth=2)
        tree = dataclasses.replace(tree, integers=[2])
        x = rng.normal(size=(6, 3)).astype(np.float32)
        x[:, 2] = np.round(x[:, 2])
        radius, nearest = margin(tree, x, scale, within_bounds=within_bounds)
        for row, r, y in zip(x, radius, nearest, strict=True):
            tried = nearest_by_trying(tree, row, scale, categories="fixed", within_bounds=within_bounds)
            assert r == tried
            if np.isinf(r):
                assert np.isnan(y).all()
                continue
            finite += 1
            assert (acts(tree, y[None]) != acts(tree, row[None])).any()
            with np.errstate(divide="ignore", invalid="ignore"):
                units = np.abs(y.astype(float) - row) / np.broadcast_to(scale, row.shape)
            assert np.nanmax(units) == r
            assert space(tree, bounds=within_bounds).contains(y[None]).all()
    assert finite > 10


@pytest.mark.parametrize("categories", ["fixed", "free"])
def test_categories_stay_or_are_any(categories):
    rng = np.random.default_rng(2)
    radii = []
    for _ in range(20):
        tree = random_grouped_tree(rng, ACTIONS["discrete"], depth=3)
        x = candidates(tree, rng.normal(size=tree.n_features).astype(np.float32))
        x = x[rng.choice(len(x), 5)]
        radius, nearest = margin(tree, x, categories=categories, within_bounds=False)
        for row, r, y in zip(x, radius, nearest, strict=True):
            tried = nearest_by_trying(tree, row, 1.0, categories=categories, within_bounds=False)
            assert r == tried
            assert np.isinf(r) or tree.predict(y) != tree.predict(row)
        radii += radius.tolist()
    assert (0 in radii) == (categories == "free")
    assert len(set(radii)) > 4


def test_noise_can_change_what_a_step_of_its_size_can(cartpole):
    rng = np.random.default_rng(3)
    x = rng.normal(size=(200, 4)) * [1, 1, 0.1, 0.3]
    size = np.array([0.5, 0, 0.02, 0.1])
    found = noise(cartpole, x, size)
    tried = np.zeros(len(x), bool)
    grid = np.array(list(product(*([-s, 0, s] for s in size))))
    for step in grid:
        moved = np.clip(x + step, cartpole.feature_low, cartpole.feature_high)
        tried |= cartpole.predict(moved) != cartpole.predict(x)
    # all thresholds of this tree are on two features, so that the corners of the box tell
    assert (found.can_change == tried).mean() > 0.99
    assert (found.can_change >= tried).all()
    assert 0 < found.share < 1
    alone = found.by_feature
    assert set(alone) == {"pole angle", "pole angular velocity"}
    assert list(alone.values()) == sorted(alone.values(), reverse=True)
    named = noise(cartpole, x, {"pole angle": 0.02, "pole angular velocity": 0.1, "cart position": 0.5})
    assert (named.can_change == found.can_change).all()
    assert max(alone.values()) <= found.share <= sum(alone.values()) + 0.2
    assert noise(cartpole, x, 0).share == 0


def test_the_end_of_the_margin_is_the_first_other_action():
    tree = DecisionTree.from_complete(
        np.array([0]), np.array([1.0]), np.eye(2), actions=DiscreteActions(2), feature_names=["x"]
    )
    radius, nearest = margin(tree, [[0.0], [2.0], [np.inf], [-np.inf]], within_bounds=False)
    above = float(np.nextafter(np.float32(1), np.float32(2)))
    assert radius.tolist() == [above, 1.0, np.inf, np.inf]
    assert nearest[:2, 0].tolist() == [above, 1.0]
    assert noise(tree, [[0.0], [2.0]], 1.0, within_bounds=False).can_change.tolist() == [False, True]


def test_nan_is_as_far_as_can_be():
    tree = DecisionTree.from_complete(
        np.array([0, 1, 1]), np.zeros(3), np.eye(4), actions=DiscreteActions(4), feature_names=["x", "y"]
    )
    radius, nearest = margin(tree, [[np.nan, 1.0]], within_bounds=False)
    assert radius.tolist() == [1.0]
    assert np.array_equal(nearest, [[np.nan, 0.0]], equal_nan=True)


def test_a_leaf_has_no_other_action_and_bad_scales_are_refused(cartpole):
    one = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.ones((1, 1)), actions=BoxActions(-2, 2, (1,)), feature_names=["x"]
    )
    assert np.isinf(margin(one, [[0.0], [1.0]]).radius).all()
    for scale, problem in [([1, 2], "shape"), (-1, "0 or more"), (np.nan, "0 or more")]:
        with pytest.raises(ValueError, match=problem):
            margin(cartpole, [0, 0, 0, 0], scale)
    with pytest.raises(ValueError, match="unknown feature 'pole'"):
        noise(cartpole, [0, 0, 0, 0], {"pole": 1})
    with pytest.raises(ValueError, match="0 or more"):
        noise(cartpole, [0, 0, 0, 0], {"pole angle": -1})


def test_many_observations_are_as_each_alone(cartpole, monkeypatch):
    x = np.random.default_rng(4).normal(size=(500, 4)) * 0.1
    whole = margin(cartpole, x)
    monkeypatch.setattr("sympol.trees.verify.robustness._DISTANCES_AT_ONCE", 37)
    parts = margin(cartpole, x)
    assert (parts.radius == whole.radius).all()
    assert (parts.nearest == whole.nearest).all()
