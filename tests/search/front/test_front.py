"""What a front is."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sympol.search.budget import Cost
from sympol.search.front.front import (
    EvaluatedCandidate,
    Front,
    FrontError,
    Point,
    ReturnSummary,
    non_dominated,
)

from .synthetic import chain, front, ladder, point, returns


@pytest.mark.parametrize("seed", range(30))
def test_the_front_is_what_no_other_tree_is_both_as_small_as_and_as_good_as(seed):
    rng = np.random.default_rng(seed)
    points = [point(2 * int(rng.integers(6)) + 1, float(rng.integers(8))) for _ in range(rng.integers(1, 25))]
    pairs = [(p.nodes, p.mean) for p in points]
    best = {
        (n, m) for n, m in pairs if not any(k <= n and r >= m and (k, r) != (n, m) for k, r in pairs)
    }  # fmt: skip
    found = non_dominated(points)
    assert [(p.nodes, p.mean) for p in found] == sorted(best)
    assert all(p is next(q for q in points if (q.nodes, q.mean) == (p.nodes, p.mean)) for p in found)


def test_a_run_gives_its_best_tree_of_at_most_so_many_nodes():
    run = ladder()
    assert [run.best(k) and run.best(k).nodes for k in (0, 1, 4, 5, 6, 7, 30, 31, 99)] == [
        None, 1, 1, 5, 5, 7, 7, 31, 31,
    ]  # fmt: skip
    assert run.best().nodes == 31


def test_the_interval_is_students():
    values = np.random.default_rng(3).exponential(size=40) * 100
    found = ReturnSummary.of(values)
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert (found.episodes, found.mean, found.std) == (40, values.mean(), values.std(ddof=1))
    np.testing.assert_allclose((found.low, found.high), expected, rtol=1e-12)
    assert Point.of(chain(3), values, method="scratch", seed=0).interval == (found.low, found.high)


@pytest.mark.parametrize("value", [500.0, -0.1, 1 / 3, 0.9649999737739563])
def test_where_all_episodes_are_alike_the_interval_is_the_mean(value):
    found = ReturnSummary.of(np.full(100, value))
    assert found.low <= found.mean <= found.high
    np.testing.assert_allclose([found.low, found.high], value, rtol=1e-12)


@pytest.mark.parametrize("values", [[], [1.0], [1.0, np.nan], [1.0, np.inf], [[1.0, 2.0]]])
def test_returns_that_are_none(values):
    with pytest.raises(FrontError, match="at least 2 episodes"):
        ReturnSummary.of(values)


def test_costs_add_up():
    assert Cost(1, 2, 3, 0.5) + Cost(10, 20, 30, 4) == Cost(11, 22, 33, 4.5)
    assert Cost(env_steps=np.int64(7)).env_steps == 7


@pytest.mark.parametrize(
    "cost", [{"env_steps": -1}, {"teacher_steps": 1.5}, {"seconds": np.nan}, {"seconds": -1}]
)
def test_costs_that_are_none(cost):
    with pytest.raises(ValueError, match=next(iter(cost))):
        Cost(**cost)


def test_a_tree_is_tested_once():
    tested = point(5, 400, test=np.nan).tested([1.0, 2.0, 3.0])
    assert tested.test == ReturnSummary.of([1, 2, 3])
    with pytest.raises(FrontError, match="has been tested"):
        tested.tested([1.0, 2.0])


@pytest.mark.parametrize("method", ["", "two\nlines", "\x1b[31m"])
def test_a_method_is_a_few_words(method):
    with pytest.raises(FrontError, match="method"):
        point(3, 1, method=method)


@pytest.mark.parametrize(
    "points",
    [
        [],
        [point(5, 2), point(3, 1)],
        [point(3, 2), point(5, 2)],
        [point(3, 2), point(5, 1)],
        [point(3, 1), point(3, 2)],
    ],
)
def test_what_is_no_front(points):
    with pytest.raises(FrontError, match="points"):
        front(points)


def test_statistics_that_contradict_themselves():
    with pytest.raises(FrontError, match="interval"):
        ReturnSummary(10, 5.0, 1.0, 6.0, 7.0)
    with pytest.raises(ValueError, match="low"):
        ReturnSummary(10, 5.0, 1.0, -np.inf, 7.0)


def test_candidates_are_checked_too():
    tried = [EvaluatedCandidate(np.int32(3), np.float32(0.5), "scratch")]
    assert Front("X", 0, (point(1, 1),), tuple(tried)).candidates == (EvaluatedCandidate(3, 0.5, "scratch"),)
    with pytest.raises(ValueError, match="mean"):
        Front("X", 0, (point(1, 1),), (EvaluatedCandidate(3, np.nan, "scratch"),))
    assert returns(1.0).low == 0.0
