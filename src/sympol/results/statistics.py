"""Statistics over trainings.

The unit is the training: its mean return over its test episodes is one number. Episodes of one policy resemble each
other more than those of two trainings do, so that pooling them would make intervals too short and differences too sure.
Every function takes such numbers, ``values [trainings]``; *strata* are one such array for each environment.
docs/design/libraries.md says which parts are SciPy's and why the bootstrap is not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

try:
    from scipy import optimize, stats
except ImportError as error:
    raise ImportError("statistics need scipy: pip install 'sympol[bench]'") from error

CONFIDENCE = 0.95
RESAMPLES = 9999
"""Resamples of a bootstrap or permutation test; with one more, the ends of an interval are whole ranks."""

Strata: TypeAlias = Sequence[Float[np.ndarray, "trainings ..."]]
Statistic: TypeAlias = Callable[[Sequence[Float[np.ndarray, "resamples trainings ..."]]], np.ndarray]
"""A function from resamples of each stratum to ``[resamples, ...]``."""


class Moments(NamedTuple):
    """Number, mean and standard deviation over trainings; a single training has no standard deviation."""

    n: int
    mean: float
    std: float | None


class Interval(NamedTuple):
    """An estimate and its confidence interval."""

    estimate: float
    low: float
    high: float


class Profile(NamedTuple):
    """The share of trainings that score more than each threshold, with a pointwise confidence band."""

    thresholds: Float[np.ndarray, " thresholds"]
    share: Float[np.ndarray, " thresholds"]
    low: Float[np.ndarray, " thresholds"]
    high: Float[np.ndarray, " thresholds"]


class Reference(NamedTuple):
    """The returns that are normalised to 0 and to 1 on one environment."""

    zero: float
    one: float


def training_means(returns: ArrayLike) -> Float[np.ndarray, " trainings"]:
    """Return the mean over the episodes of each training, from ``returns [trainings, episodes]``."""
    return np.asarray(returns, float).mean(axis=1)


def moments(values: ArrayLike) -> Moments:
    """Return number, mean and standard deviation (ddof 1) over trainings."""
    values = np.asarray(values, float)
    return Moments(len(values), float(values.mean()), float(values.std(ddof=1)) if len(values) > 1 else None)


def mean_interval(values: ArrayLike, confidence: float = CONFIDENCE) -> Interval | None:
    """Return the mean over trainings with Student's interval.

    The interval is exact for normal values, however few; a percentile bootstrap of five would be a third too short.

    Args:
        values: One number for each training.
        confidence: The probability that the interval holds the mean.

    Returns:
        The interval, or None for a single training.
    """
    n, mean, std = moments(values)
    if std is None:
        return None
    half = float(stats.t.ppf((1 + confidence) / 2, n - 1)) * std / np.sqrt(n)
    return Interval(mean, mean - half, mean + half)


def stratified_bootstrap(
    strata: Strata,
    statistic: Statistic,
    *,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a statistic and its percentile interval, resampling trainings within each environment.

    This is the bootstrap of rliable (Agarwal et al. 2021, Deep RL at the edge of the statistical precipice). With five
    trainings an environment the interval is about a tenth too short, as that of every percentile bootstrap: √(1 − 1/n).

    Args:
        strata: An array for each environment, its first axis over trainings.
        statistic: The statistic, vectorised over resamples.
        resamples: The number of resamples.
        confidence: The probability that the interval is meant to have.
        seed: Seed of the resampling.

    Returns:
        The statistic, and the lower and upper ends of its interval.
    """
    rng = np.random.default_rng(seed)
    strata = [np.asarray(values, float) for values in strata]
    drawn = [values[rng.integers(len(values), size=(resamples, len(values)))] for values in strata]
    ranked = np.sort(statistic(drawn), axis=0)
    tail = (1 - confidence) / 2 * (resamples + 1)
    # ranks, not interpolation: a resample may be worth infinity
    low, high = (
        ranked[max(0, int(tail) - 1)],
        ranked[min(resamples - 1, int(np.ceil(resamples + 1 - tail)) - 1)],
    )
    return statistic([values[None] for values in strata])[0], low, high


def bootstrap_interval(strata: Strata, statistic: Statistic, **options: float) -> Interval:
    """Return the result of `stratified_bootstrap` for a statistic that is one number."""
    return Interval(*map(float, stratified_bootstrap(strata, statistic, **options)))  # pyright: ignore[reportArgumentType]


def mean_of_environments(drawn: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean over environments of the mean over trainings, so that each environment counts the same."""
    return np.mean([values.mean(axis=1) for values in drawn], axis=0)


def interquartile_mean(drawn: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean of the middle half of all trainings, which no single lucky or failed training decides."""
    return stats.trim_mean(np.concatenate(drawn, axis=1), 0.25, axis=1)


def performance_profile(
    strata: Strata, thresholds: ArrayLike, *, resamples: int = 1999, seed: int = 0
) -> Profile:
    """Return the share of trainings whose score exceeds each threshold, each environment counting the same.

    Args:
        strata: Normalised scores, an array ``[trainings]`` for each environment.
        thresholds: The thresholds.
        resamples: The number of resamples of the bootstrap.
        seed: Seed of the bootstrap.

    Returns:
        The shares with a band that is pointwise, not for the whole curve at once.
    """
    thresholds = np.asarray(thresholds, float)
    exceeding = [np.asarray(values, float)[:, None] > thresholds for values in strata]
    share, low, high = stratified_bootstrap(exceeding, mean_of_environments, resamples=resamples, seed=seed)
    return Profile(thresholds, share, low, high)


def reference(rows: Iterable[ArrayLike]) -> Reference:
    """Return the returns that are normalised to 0 and 1 on one environment.

    The paper: between "the top- and worse-performing models. Instead of the worse-performing model, we use the 20% test
    reward quantile to account for outliers". So 1 is the best row's mean and 0 the 0.2-quantile of all trainings of
    all rows. If hardly any training is bad enough for that, 0 is the worst training.

    Args:
        rows: The values ``[trainings]`` of each row of a table.
    """
    rows = [np.asarray(values, float) for values in rows]
    best, pooled = max(float(values.mean()) for values in rows), np.concatenate(rows)
    zero = float(np.quantile(pooled, 0.2))
    return Reference(zero if zero < best else float(pooled.min()), best)


def normalised(values: ArrayLike, between: Reference) -> np.ndarray:
    """Return values scaled so that ``between`` becomes 0 and 1; if its ends are equal, 1 from there upwards."""
    values, (zero, one) = np.asarray(values, float), between
    return (values - zero) / (one - zero) if one > zero else np.where(values >= one, 1.0, 0.0)


def normalised_mean(drawn: Sequence[np.ndarray]) -> np.ndarray:
    """Return the mean over environments of the normalised mean, at least 0 on each: the paper's "normalized mean"."""
    return np.mean([np.maximum(values.mean(axis=1), 0) for values in drawn], axis=0)


def cohens_d(drawn: Sequence[np.ndarray]) -> np.ndarray:
    """Return Cohen's d between validation and test, for one stratum.

    The stratum holds pairs ``[trainings, 2]``: a training's mean validation and mean test return. d is the difference
    of the means in units of the pooled standard deviation (ddof 1) over trainings. As in the paper a positive d says
    that validation was better: something was lost. (Its 500 against 446 with d = 0.632 = √10 / 5 is one failed
    training among five, which pins down unit and ddof.) Without any spread d is 0 if the means are the same and else
    infinite.
    """
    (pairs,) = drawn
    difference = -np.diff(pairs.mean(axis=1), axis=1)[:, 0]
    spread = np.sqrt(pairs.var(axis=1, ddof=1).mean(axis=1))
    # equal numbers have means that differ in the last bit
    least = 1e-9 * np.abs(pairs).max(axis=(1, 2))
    difference = np.where(np.abs(difference) <= least, 0.0, difference)
    without = np.where(difference == 0, 0.0, np.copysign(np.inf, difference))
    return np.where(spread <= least, without, difference / np.where(spread <= least, 1.0, spread))


def d_interval(pairs: ArrayLike, confidence: float = CONFIDENCE) -> Interval:
    """Return Cohen's d of pairs ``[trainings, 2]``, with the interval of the noncentral t distribution.

    Measured with five normal trainings, a true d of 0 and 2: it holds the true d 95 times in a hundred where validation
    and test vary independently, and 96 to 100 times where they vary together (ρ = 0.9). A percentile bootstrap of the
    same pairs does so 84 times at 0 and 65 to 77 times at 2; so tables do not show that one.
    """
    pairs = np.asarray(pairs, float)
    d, n = float(cohens_d([pairs[None]])[0]), len(pairs)
    if not np.isfinite(d) or np.ptp(pairs) <= 1e-9 * np.abs(pairs).max():
        return Interval(d, d, d)
    t, tail = abs(d) * np.sqrt(n / 2), (1 - confidence) / 2

    def noncentrality(chance: float) -> float:
        solution = optimize.brentq(lambda nc: stats.nct.cdf(t, 2 * n - 2, nc) - chance, -4.0, 4.0 + 4.0 * t)
        return float(solution) / np.sqrt(n / 2)  # pyright: ignore[reportArgumentType]

    low, high = noncentrality(1 - tail), noncentrality(tail)
    return Interval(d, low, high) if d >= 0 else Interval(d, -high, -low)


def mean_interval_of(intervals: Sequence[Interval]) -> Interval:
    """Return the mean of independent estimates, with an interval from theirs (Zou and Donner 2008, MOVER).

    A side's distance is the root of the sum of squares of the distances, over their number.
    """
    estimates, low, high = np.array(intervals).T
    if not np.isfinite(estimates).all():
        return Interval(float(estimates[~np.isfinite(estimates)][0]), -np.inf, np.inf)
    mean, n = float(estimates.mean()), len(estimates)
    below, above = (float(np.sqrt(np.sum((end - estimates) ** 2))) / n for end in (low, high))
    return Interval(mean, mean - below, mean + above)
