"""Statistics against closed forms, scipy and plain loops; intervals hold what they should."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats

from sympol.results.statistics import (
    Interval,
    Reference,
    bootstrap_interval,
    cohens_d,
    d_interval,
    interquartile_mean,
    mean_interval,
    mean_interval_of,
    mean_of_environments,
    moments,
    normalised,
    normalised_mean,
    performance_profile,
    reference,
    stratified_bootstrap,
    training_means,
)


def d_of(pairs: list[tuple[float, float]]) -> float:
    return float(cohens_d([np.array([pairs], float)])[0])


def test_the_unit_is_the_training():
    returns = [[0.0, 2.0], [3.0, 5.0], [4.0, 10.0]]
    assert training_means(returns).tolist() == [1, 4, 7]
    assert moments(training_means(returns)) == (3, 4.0, 3.0)
    assert np.std(returns, ddof=1) != 3  # as pooled episodes would have it
    assert moments([5.0]) == (1, 5.0, None)


def test_student_s_interval():
    values = [1.0, 2.0, 4.0, 4.5, 9.0]
    interval = mean_interval(values)
    assert interval is not None
    theirs = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    np.testing.assert_allclose(interval[1:], theirs)
    assert mean_interval([3.0]) is None
    assert mean_interval([3.0, 3.0]) == (3, 3, 3)


def test_the_bootstrap_of_one_stratum_is_scipy_s():
    values = np.random.default_rng(0).gamma(2.0, size=12)
    ours = bootstrap_interval([values], mean_of_environments)
    theirs = stats.bootstrap(
        (values,), np.mean, method="percentile", n_resamples=9999, rng=np.random.default_rng(1)
    )
    assert ours.estimate == pytest.approx(values.mean())
    np.testing.assert_allclose(ours[1:], theirs.confidence_interval, rtol=0.03)


def test_strata_are_resampled_apart():
    """Against a plain loop; strata of one value each leave nothing to chance."""
    strata = [np.array([0.0, 1.0, 2.0]), np.array([10.0, 30.0])]
    rng, drawn = np.random.default_rng(5), []
    for _ in range(4000):
        means = [np.mean([values[rng.integers(len(values))] for _ in values]) for values in strata]
        drawn.append(np.mean(means))
    ours = bootstrap_interval(strata, mean_of_environments)
    np.testing.assert_allclose(ours[1:], np.percentile(drawn, [2.5, 97.5]), atol=0.4)
    assert ours.estimate == 10.5  # not the mean of the five values
    assert bootstrap_interval([np.full(5, 1.0), np.full(5, 3.0)], mean_of_environments) == (2, 2, 2)


def test_the_bootstrap_s_ends_are_ranks():
    """With 19 resamples a 90 % interval is from the least to the greatest."""
    values = np.arange(8.0)
    rng = np.random.default_rng(3)
    means = values[rng.integers(8, size=(19, 8))].mean(axis=1)
    _, low, high = stratified_bootstrap([values], mean_of_environments, resamples=19, confidence=0.9, seed=3)
    assert (low, high) == (means.min(), means.max())


def test_the_stratified_interval_holds_the_truth():
    """25 trainings on five environments that differ: about nine times in ten, as √(1 − 1/5) of its length lets it."""
    rng, centres = np.random.default_rng(0), np.arange(5.0) * 100
    held = 0
    for seed in range(400):
        strata = [centre + rng.standard_normal(5) for centre in centres]
        interval = bootstrap_interval(strata, mean_of_environments, resamples=499, seed=seed)
        held += interval.low <= centres.mean() <= interval.high
    assert 0.86 <= held / 400 <= 0.96


def test_interquartile_mean():
    strata = [np.array([0.0, 1.0, 2.0, 100.0]), np.array([3.0, 4.0, 5.0, -100.0])]
    pooled = np.concatenate(strata)
    assert interquartile_mean([values[None] for values in strata])[0] == stats.trim_mean(pooled, 0.25) == 2.5


def test_profile_counts_trainings():
    strata = [np.array([0.1, 0.5, 0.9]), np.array([0.5, 0.6, 0.7])]
    profile = performance_profile(strata, [0.0, 0.5, 0.65, 1.0], resamples=199)
    np.testing.assert_allclose(profile.share, [1, (1 / 3 + 2 / 3) / 2, (1 / 3 + 1 / 3) / 2, 0])
    assert np.all((profile.low <= profile.share) & (profile.share <= profile.high))
    assert profile.low[0] == profile.high[0] == 1


def test_normalised_scores():
    rows = [[500.0, 500.0], [300.0, 400.0], [0.0, 100.0]]
    between = reference(rows)
    assert between == (float(np.quantile(np.ravel(rows), 0.2)), 500)
    np.testing.assert_allclose(normalised([100.0, 300.0, 500.0, 600.0], between), [0, 0.5, 1, 1.25])
    assert reference([[400.0], [0.0, *[500.0] * 20]]) == (0, 10_000 / 21)  # hardly one is bad: the worst
    assert normalised([7.0, 7.0], reference([[7.0, 7.0]])).tolist() == [1, 1]
    assert normalised([6.0], Reference(7, 7)).tolist() == [0]


def test_the_normalised_mean_is_never_below_zero_on_an_environment():
    assert normalised_mean([np.array([[-3.0, -5.0]]), np.array([[1.0, 0.5]])]).tolist() == [0.375]


def test_cohens_d_is_the_paper_s():
    """500 in validation, one training in five fails the test: 0.632, whatever it loses."""
    for lost in (10.0, 270.0):
        assert d_of([(500, 500)] * 4 + [(500, 500 - lost)]) == pytest.approx(math.sqrt(10) / 5)
    assert round(math.sqrt(10) / 5, 3) == 0.632
    a, b = np.random.default_rng(1).normal(size=(2, 7))
    pooled = math.sqrt((a.var(ddof=1) + b.var(ddof=1)) / 2)
    assert d_of(list(zip(a, b, strict=True))) == pytest.approx((a.mean() - b.mean()) / pooled)


def test_cohens_d_without_spread():
    assert d_of([(500, 500)] * 5) == 0
    assert d_of([(500, 490)] * 5) == math.inf
    assert d_of([(490, 500)] * 5) == -math.inf
    assert d_of([(0.1 + 0.2, 0.3)] * 5) == 0  # nor with what rounding makes of equals
    assert d_interval([(500, 500)] * 5) == (0, 0, 0)
    assert d_interval([(500, 490)] * 5) == (math.inf, math.inf, math.inf)
    assert mean_interval_of([Interval(math.inf, math.inf, math.inf), Interval(0, -1, 1)]) == (
        math.inf,
        -math.inf,
        math.inf,
    )


def test_the_interval_of_d():
    """It turns with the sign, and its ends are where the observed t is at the tails."""
    pairs = np.array([(1.0, 0.2), (2.0, 0.1), (1.5, 1.4), (0.3, 0.2), (2.2, 1.1)])
    d = d_interval(pairs)
    np.testing.assert_allclose(d_interval(pairs[:, ::-1]), [-d.estimate, -d.high, -d.low])
    root = math.sqrt(5 / 2)
    assert stats.nct.cdf(d.estimate * root, 8, d.low * root) == pytest.approx(0.975)
    assert stats.nct.cdf(d.estimate * root, 8, d.high * root) == pytest.approx(0.025)
    t = stats.ttest_ind(pairs[:, 0], pairs[:, 1])
    assert (d.low > 0) == (t.pvalue < 0.05)  # the same question


@pytest.mark.parametrize("true_d", [0.0, 2.0])
def test_the_interval_of_d_holds_the_truth(true_d):
    rng, held = np.random.default_rng(0), 0
    for _ in range(300):
        pairs = rng.standard_normal((5, 2)) + np.array([true_d, 0])
        d = d_interval(pairs)
        held += d.low <= true_d <= d.high
    assert 0.92 <= held / 300 <= 0.98


def test_the_mean_of_intervals():
    mean = mean_interval_of([Interval(1, 0, 3), Interval(3, 3, 3), Interval(2, 1, 3)])
    np.testing.assert_allclose(mean, [2, 2 - math.sqrt(2) / 3, 2 + math.sqrt(5) / 3])
    assert mean_interval_of([Interval(1, 0, 3)]) == (1, 0, 3)


def test_reading_records_and_tables_needs_no_scipy_and_statistics_say_what_they_need():
    code = "import sys; sys.modules['scipy'] = None; import sympol.bench.{}"
    modules = "record, sympol.bench.tables"
    subprocess.run([sys.executable, "-c", code.format(modules)], check=True)
    done = subprocess.run(
        [sys.executable, "-c", code.format("render")], capture_output=True, text=True, check=False
    )
    assert "statistics need scipy: pip install 'sympol[bench]'" in done.stderr
