"""Several whole runs of one task."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sympol.search.front.front import FrontError, best_under_sizes, sizes_of

from .synthetic import front, ladder, point


def test_the_mean_is_over_runs_of_tests_of_what_validation_chose():
    # validation prefers the tree of 5 nodes, whose test is worse
    runs = [
        front([point(3, 10, test=9), point(5, 20 + seed, test=seed)], seed=seed) for seed in (0, 3, 9)
    ]  # fmt: skip
    small, both = best_under_sizes(runs, [3, 8])
    assert (small.mean, small.std) == (9, 0)
    assert [(seed, of.nodes) for seed, of in both.runs] == [(0, 5), (3, 5), (9, 5)]
    tests = [0, 3, 9]
    assert (both.mean, both.std) == (4, np.std(tests, ddof=1))
    expected = stats.ttest_1samp(tests, 0).confidence_interval(0.95)
    np.testing.assert_allclose((both.spread.low, both.spread.high), expected, rtol=1e-12)


def test_a_run_without_a_tree_so_small_leaves_no_mean():
    runs = [front([point(1, 5), point(5, 20)], seed=0), front([point(5, 20)], seed=1)]
    small, large = best_under_sizes(runs, [3, 5])
    assert small.mean is small.std is small.spread is None
    assert [of and of.nodes for _, of in small.runs] == [1, None]
    assert large.mean == 19


def test_one_run_has_no_spread():
    [only] = best_under_sizes([ladder()], [5])
    assert (only.mean, only.std, only.spread) == (399, None, None)


@pytest.mark.parametrize(
    ("runs", "says"),
    [
        ([], "one task"),
        ([ladder(0), ladder(1, environment="Acrobot-v1")], "one task"),
        ([ladder(0), ladder(0)], "seeds of their own"),
        ([front([point(1, 1, test=np.nan)], seed=4)], "seed 4 was not tested"),
    ],
)
def test_runs_that_cannot_be_summed_up(runs, says):
    with pytest.raises(FrontError, match=says):
        best_under_sizes(runs, [31])


def test_all_sizes():
    assert sizes_of([ladder(), front([point(3, 1), point(7, 2)], seed=1)]) == [1, 3, 5, 7, 31]
