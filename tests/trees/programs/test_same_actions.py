"""Every exported program is compiled and run here, and acts as its tree does on a million observations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sympol import DecisionTree
from sympol.trees.export import common
from sympol.trees.export.check import check_observations
from sympol.trees.floats import double_threshold, flushed

from ..samples import plain_leaf
from .running import IDS, PROGRAMS, ran, same, seen, trees, with_start


@pytest.mark.slow
@pytest.mark.parametrize(("to", "options"), PROGRAMS, ids=IDS)
def test_it_acts_as_the_tree_does_on_a_million_observations(to, options):
    n = 0
    for name, tree in trees().items():
        x, expected = seen(name)
        assert same(ran(tree, to, x, **options), expected, to), name
        n += len(x)
    assert n > 1_000_000


def test_what_the_programs_are_compared_with_is_the_plain_loop():
    for name, tree in trees().items():
        x, expected = seen(name)
        for row, action in zip(x[:50], expected[:50], strict=True):
            leaf = plain_leaf(tree, row)
            assert (np.ravel(tree.actions.decide(tree.value[[leaf]])) == action).all()


def test_observations_tried_on_the_command_s_request_tell_the_same_things():
    for tree in trees().values():
        x = check_observations(tree, 30_000)
        tree.predict(x)  # none is refused
        free = [i for i in range(tree.n_features) if i not in tree.group_of]
        numbers = x[:, free]
        assert np.isnan(numbers).any()
        assert np.isposinf(numbers).any()
        assert np.isneginf(numbers).any()
        assert ((numbers != 0) & (flushed(numbers) == 0)).any()
        assert (np.signbit(numbers) & (numbers == 0)).any()
        asked = np.flatnonzero(~tree.is_leaf)[:50]
        for feature, threshold in zip(tree.feature[asked], tree.threshold[asked], strict=True):
            if feature in free:
                above = np.nextafter(threshold, np.float32(np.inf))
                assert (x[:, feature] == threshold).any()
                assert (x[:, feature] == above).any()


@pytest.mark.parametrize(
    "threshold", [0.0, -0.0, 1.0, 0.1, -0.1, 2.0**-126, -(2.0**-126), 3.4028235e38, -3.4028235e38]
)
def test_a_threshold_takes_rounding_on_itself(threshold):
    check_double_threshold(float(np.float32(threshold)))


def test_random_thresholds_take_rounding_on_themselves():
    bits = np.random.default_rng(22).integers(0, 2**32, 3000, dtype=np.uint32)
    for threshold in flushed(bits.view(np.float32)[np.isfinite(bits.view(np.float32))]):
        check_double_threshold(float(threshold))


def check_double_threshold(threshold: float) -> None:
    at = double_threshold(threshold)
    above = math.nextafter(at, math.inf)
    assert flushed(at) <= np.float32(threshold) < flushed(above)
    # NumPy compares its float32 numbers with the threshold rounded to float32
    number = np.float32(threshold)
    assert number <= at
    with np.errstate(over="ignore"):
        first = np.float32(2.0**-126) if threshold == 0 else np.nextafter(number, np.float32(np.inf))
    assert not first <= at


def act_of(tree: DecisionTree) -> Callable[[Any], Any]:
    namespace: dict[str, Any] = {"__name__": "policy"}
    exec(tree.to_python(), namespace)
    return namespace["act"]


def test_python_takes_numbers_of_every_kind():
    rng = np.random.default_rng(23)
    tree = trees()["2047 nodes"]
    act = act_of(tree)
    doubles = np.array([double_threshold(t) for t in tree.threshold[~tree.is_leaf]])
    doubles = np.concatenate(
        [doubles, np.nextafter(doubles, np.inf), [1e300, -1e300, 5e-324, np.nan, np.inf, 0.0]]
    )
    for row in rng.choice(doubles, (4000, tree.n_features)):
        expected = tree.predict(row)
        assert act(row.tolist()) == act(tuple(row.tolist())) == act(row) == expected
    for row in rng.integers(-3, 3, (200, tree.n_features)):
        assert act(row.tolist()) == act(row) == act(row.astype(np.int8)) == tree.predict(row)
    for row in rng.choice(seen("2047 nodes")[0].ravel(), (500, tree.n_features)):
        assert act(row) == tree.predict(row)
    assert act([True] * 5) == tree.predict([1] * 5)


def test_nesting_grows_with_the_logarithm_of_the_leaves():
    for tree in trees().values():
        deepest = max(step.level for step in common.steps(tree))
        assert deepest <= common.MAX_HEIGHT + math.log2(tree.n_leaves)
        kinds = [step.kind for step in common.steps(tree)]
        assert kinds.count("if") == kinds.count("end") == tree.n_leaves - 1
        assert kinds.count("answer") == tree.n_leaves


@pytest.mark.parametrize("start", [-(2**31), 2**31 - 2, 2**31 - 1, 2**40, -(2**53), 2**53 - 1])
@pytest.mark.parametrize(("to", "options"), PROGRAMS[:-1], ids=IDS[:-1])
def test_large_actions_are_whole(start, to, options):
    if to == "rust" and start not in (2**31 - 2, 2**40):
        return
    x = np.array([[0], [1], [np.nan]], np.float32)
    assert ran(with_start(start), to, x, **options).ravel().tolist() == [start, start + 1, start + 1]
