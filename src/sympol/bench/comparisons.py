"""Which methods differ? Tests over trainings, corrected for how many are made."""

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
    """One method beside the one it is compared with."""

    p: float | None
    """Corrected for all comparisons of its family; None for the one that the others are compared with."""
    difference: float
    """Of the means: its own less the other's."""

    @property
    def is_different(self) -> bool:
        """Whether the difference is more than chance would make of one method."""
        return self.p is not None and self.p < ALPHA


def welch(a: ArrayLike, b: ArrayLike) -> float:
    """Two-sided p of Welch's t-test for equal means, over trainings; no equal variances assumed.

    A single training differs from nothing: p = 1. Where neither side has any spread there is no t, and the permutation
    test answers.
    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    if min(len(a), len(b)) < 2:
        return 1.0
    if _constant(a) and _constant(b):
        return permutation(a, b)
    sides = [number for side in (a, b) for number in (side.mean(), side.std(ddof=1), len(side))]
    return float(stats.ttest_ind_from_stats(*sides, equal_var=False).pvalue)


def paired(a: ArrayLike, b: ArrayLike) -> float:
    """Two-sided p of the paired t-test for equal means, over trainings: two measurements of the same ones.

    Where all differ by the same there is no t, and the test of signs answers: n of n, 2 / 2^n.
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
    """Two-sided p of the permutation test for the difference of means, over trainings.

    Exact up to 9999 permutations, drawn beyond. Five against five can give no less than 2 / 252 = 0.008. A single
    training differs from nothing: p = 1.
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
    """Holm's p-values: rejecting those below α errs in any of them with a chance of at most α."""
    order = np.argsort(ps, kind="stable")
    factors = len(ps) - np.arange(len(ps))
    adjusted = np.minimum(1, np.maximum.accumulate(np.asarray(ps, float)[order] * factors))
    return np.asarray(adjusted)[np.argsort(order, kind="stable")].tolist()


def against(
    values: Mapping[Name, ArrayLike], one: Name, *, test: TestName = "welch"
) -> dict[Name, Comparison]:
    """Every other method beside ``one``, Holm's correction over all of them.

    Trees of one teacher are not independent of each other, which both tests suppose; that makes them careful.
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
    """Every method beside that with the highest mean; those that are not different from it are the paper's bold.

    Few trainings make many methods "not different": that is no proof of sameness.
    """
    if not values:
        return {}
    return against(
        values, max(values, key=lambda name: float(np.mean(np.asarray(values[name], float)))), test=test
    )


def _constant(values: np.ndarray) -> bool:
    return bool(np.ptp(values) <= 1e-9 * np.abs(values).max())
