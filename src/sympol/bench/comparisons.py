"""Tests whether methods differ, over trainings, corrected for the number of tests."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Literal, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..results.statistics import RESAMPLES, stats

ALPHA = 0.05

Name = TypeVar("Name", bound=Hashable)
TestName: TypeAlias = Literal["welch", "permutation"]


class Comparison(NamedTuple):
    """A method compared with another one."""

    p: float | None
    """The p-value, corrected for all comparisons of the family; None for the method that others are compared with."""
    difference: float
    """The difference of the means, this method's minus the other's."""

    @property
    def is_different(self) -> bool:
        """True if the difference is significant at `ALPHA`."""
        return self.p is not None and self.p < ALPHA


def welch(a: ArrayLike, b: ArrayLike) -> float:
    """Return the two-sided p-value of Welch's t-test for equal means, which does not assume equal variances.

    Without any spread on either side there is no t, and the permutation test is used. A single training gives p = 1.

    Args:
        a: One number for each training.
        b: The same for the other method.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if min(len(a), len(b)) < 2:
        return 1.0
    if _constant(a) and _constant(b):
        return permutation(a, b)
    sides = [number for side in (a, b) for number in (side.mean(), side.std(ddof=1), len(side))]
    return float(stats.ttest_ind_from_stats(*sides, equal_var=False).pvalue)


def paired(a: ArrayLike, b: ArrayLike) -> float:
    """Return the two-sided p-value of the paired t-test for equal means.

    If all pairs differ by the same there is no t, and the sign test is used: n of n, 2 / 2^n. A single pair gives
    p = 1.

    Args:
        a: One number for each training.
        b: Another measurement of the same trainings, in the same order.
    """
    differences = np.asarray(a, float) - np.asarray(b, float)
    n, mean = len(differences), float(differences.mean())
    least = 1e-9 * max(np.abs(np.asarray(a)).max(), np.abs(np.asarray(b)).max())
    if n < 2 or np.abs(differences).max() <= least:
        return 1.0
    if np.ptp(differences) <= least:
        return 2.0 ** (1 - n)
    t = abs(mean) / (float(differences.std(ddof=1)) / np.sqrt(n))
    return float(2 * stats.t.sf(t, n - 1))


def permutation(a: ArrayLike, b: ArrayLike, *, seed: int = 0) -> float:
    """Return the two-sided p-value of the permutation test for the difference of means.

    It is exact up to 9999 permutations, which are drawn at random beyond. Five against five can give no less than
    2 / 252 = 0.008. A single training gives p = 1.

    Args:
        a: One number for each training.
        b: The same for the other method.
        seed: Seed of the random permutations.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if min(len(a), len(b)) < 2:
        return 1.0

    def difference(x: np.ndarray, y: np.ndarray, axis: int) -> np.ndarray:
        return x.mean(axis=axis) - y.mean(axis=axis)

    return float(
        stats.permutation_test(
            (a, b),
            difference,
            permutation_type="independent",
            vectorized=True,
            n_resamples=RESAMPLES,
            rng=np.random.default_rng(seed),
        ).pvalue
    )


TESTS: Mapping[TestName, Callable[[ArrayLike, ArrayLike], float]] = {
    "welch": welch,
    "permutation": permutation,
}


def holm(ps: Sequence[float]) -> list[float]:
    """Return Holm's adjusted p-values: rejecting those below α makes any false rejection with probability at most α."""
    order = np.argsort(ps, kind="stable")
    factors = len(ps) - np.arange(len(ps))
    adjusted = np.minimum(1, np.maximum.accumulate(np.asarray(ps, float)[order] * factors))
    return np.asarray(adjusted)[np.argsort(order, kind="stable")].tolist()


def against(
    values: Mapping[Name, ArrayLike], one: Name, *, test: TestName = "welch"
) -> dict[Name, Comparison]:
    """Compare every other method with ``one``, with Holm's correction over all of them.

    Both tests suppose independent samples. Trees of one teacher are not, which makes the tests conservative.

    Args:
        values: One number for each training, by method.
        one: The method that the others are compared with.
        test: The test.

    Returns:
        A comparison for each method, that of ``one`` without a p-value.
    """
    others = [name for name in values if name != one]
    ps = holm([TESTS[test](values[name], values[one]) for name in others])
    base = float(np.mean(np.asarray(values[one], float)))
    compared = {
        name: Comparison(p, float(np.mean(np.asarray(values[name], float))) - base)
        for name, p in zip(others, ps, strict=True)
    }
    return {name: compared.get(name, Comparison(None, 0.0)) for name in values}


def best_and_not_different(
    values: Mapping[Name, ArrayLike], *, test: TestName = "welch"
) -> dict[Name, Comparison]:
    """Compare every method with that of the highest mean; the paper prints those that do not differ from it in bold.

    With few trainings many methods do not differ, which does not prove that they are equal.

    Args:
        values: One number for each training, by method.
        test: The test.
    """
    if not values:
        return {}
    return against(
        values, max(values, key=lambda name: float(np.mean(np.asarray(values[name], float)))), test=test
    )


def _constant(values: np.ndarray) -> bool:
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())
