"""Tests of differences against scipy, enumerations and the errors they are allowed."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from sympol.bench.comparisons import against, best_and_not_different, holm, paired, permutation, welch

RNG = np.random.default_rng(0)
A, B = RNG.normal(0, 1, 5), RNG.normal(1.5, 3, 6)


def test_welch_is_scipy_s():
    assert welch(A, B) == pytest.approx(stats.ttest_ind(A, B, equal_var=False).pvalue)
    assert welch(A, A) == 1


def test_where_there_is_no_t():
    assert welch([500.0] * 5, [500.0] * 5) == 1
    assert welch([500.0] * 5, [490.0] * 5) == pytest.approx(2 / 252)
    assert welch([500.0], [0.0, 1.0]) == 1  # one training differs from nothing
    assert 0 < welch([500.0] * 5, [490.0, 480.0, 470.0, 460.0, 450.0]) < 0.05  # one side has a spread


def test_permutations_are_counted():
    pooled, n = np.concatenate([A, B]), len(A)
    observed, below, above = A.mean() - B.mean(), 0, 0
    choices = list(combinations(range(len(pooled)), n))
    for choice in choices:
        rest = np.delete(pooled, choice)
        difference = pooled[list(choice)].mean() - rest.mean()
        below, above = below + (difference <= observed + 1e-12), above + (difference >= observed - 1e-12)
    assert len(choices) == 462
    assert permutation(A, B) == pytest.approx(2 * min(below, above) / 462)
    assert permutation([0.0] * 5, [1.0] * 5) == pytest.approx(2 / 252)


def test_the_paired_test_is_scipy_s():
    before, after = A, A + RNG.normal(0.3, 0.2, 5)
    assert paired(before, after) == pytest.approx(stats.ttest_rel(before, after).pvalue)
    assert paired([500.0] * 5, [500.0] * 5) == 1
    assert paired([500.0] * 5, [490.0] * 5) == 1 / 16


def test_holm():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.6]) == [1, 1]
    assert holm([]) == []


def test_holm_errs_as_rarely_as_it_says():
    """Six methods that are the same: some difference is found in at most one table of twenty."""
    rng, wrong = np.random.default_rng(1), 0
    for _ in range(300):
        values = {name: rng.standard_normal(5) for name in range(6)}
        wrong += any(of.is_different for of in against(values, 0).values())
    assert wrong / 300 <= 0.08


def test_the_best_and_those_that_do_not_differ():
    values = {"best": [10.0, 11.0, 12.0], "near": [9.0, 11.0, 12.5], "far": [1.0, 2.0, 1.5], "one": [0.0]}
    of = best_and_not_different(values)
    assert [name for name in values if not of[name].is_different] == ["best", "near", "one"]
    assert of["best"].p is None
    assert of["far"].p == pytest.approx(3 * welch(values["far"], values["best"]))
    assert of["far"].difference == pytest.approx(1.5 - 11)
    assert best_and_not_different({}) == {}
    assert best_and_not_different({"alone": [1.0, 2.0]})["alone"] == (None, 0)


@pytest.mark.parametrize("test", [welch, permutation])
def test_a_single_training_differs_from_nothing(test):
    assert test([1.0], [2.0]) == test([1.0], [2.0, 3.0]) == test([1.0, 2.0], [3.0]) == 1.0


def test_five_against_five_by_permutation_can_differ_from_six_at_most():
    """2 / 252 seven times is above 0.05: with more rivals the exact test can say nothing."""
    values = {name: np.full(5, -float(name)) for name in range(8)}
    few = best_and_not_different({name: values[name] for name in range(7)}, test="permutation")
    many = best_and_not_different(values, test="permutation")
    assert all(of.is_different for name, of in few.items() if name)
    assert all(not of.is_different for of in many.values())
