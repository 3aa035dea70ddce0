"""Compare trees on shared episodes, with as few episodes as it takes.

All trees play the same numbered episodes, so only the paired differences matter. A `ReturnCache` plays no tree
twice in an episode. `compare` looks after 32 episodes, 64, 128, …: is the mean difference above ``-margin``, or
below? Each look is a pair of one-sided t-tests. Repeated looks and many candidates find something by chance
more often, so the allowed error ``alpha`` is divided by the number of looks and of candidates (Bonferroni's
inequality; Dunn, "Multiple comparisons among means", 1961). That holds however looks and candidates depend on
each other, and is conservative, as they have much in common. (Group-sequential designs such as Pocock's of 1977
are sharper, for normal differences.)

The t-test is only approximate for differences far from normal. The usual worst case is a change that matters in
one episode of a hundred and in none of the first. Episodes in which nothing differs therefore prove nothing:
while there are no others, the next look is awaited, up to the last.

`successive_halving` (Jamieson and Talwalkar 2016) ranks many variants of a tree: all play a few episodes, the
better half twice as many, and so on, always the same episodes as the tree itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Float32, Shaped

from ..trees import DecisionTree
from .evaluators.base import Evaluator


class ReturnCache:
    """Returns by tree, of the episodes from ``first_episode`` on."""

    def __init__(self, evaluator: Evaluator, first_episode: int = 0) -> None:
        self.evaluator, self.first_episode = evaluator, first_episode
        self._known: dict[DecisionTree, Float32[np.ndarray, " episodes"]] = {}

    def of(self, tree: DecisionTree, number: int) -> Float32[np.ndarray, " episodes"]:
        """Return the returns of one tree in the first ``number`` episodes."""
        return self.of_all([tree], number)[0]

    def of_all(
        self, trees: Sequence[DecisionTree], number: int, *, like: DecisionTree | None = None
    ) -> Float32[np.ndarray, "trees episodes"]:
        """Return the returns of many trees in the first ``number`` episodes; what is missing is played in one batch.

        ``like`` is a tree that most of them mostly do as, if there is one: see `Evaluator.play_variants`.
        """
        by_played: dict[int, dict[DecisionTree, None]] = {}
        for tree in trees:
            played = len(self._known.get(tree, ()))
            if played < number:
                by_played.setdefault(played, {})[tree] = None
        for played, some in by_played.items():
            more = range(self.first_episode + played, self.first_episode + number)
            playing = [tree for tree in some if tree != like]
            if like is None:
                returns = self.evaluator.play(playing, more).returns
            else:
                returns = self.evaluator.play_variants(like, playing, more).returns
                playing.insert(0, like)
            for tree, new in zip(playing, returns, strict=True):
                if tree in some:
                    known = self._known[tree] if played else new[:0]
                    self._known[tree] = np.concatenate([known, new])
        return np.stack([self._known[tree][:number] for tree in trees])


FIRST, LAST = 32, 1024
"""Episodes of the first look, and of the last."""
ALPHA = 0.05
"""The chance of a wrong answer that is allowed, of "worse" and of "not worse" each."""

Answer: TypeAlias = Literal["worse", "not worse", "equal", "undecided"]
Differences: TypeAlias = Callable[[int], Shaped[np.ndarray, " episodes"]]
"""The differences in the first so many episodes."""


class Comparison(NamedTuple):
    """The result of a comparison."""

    answer: Answer
    """``"worse"``: by more than the margin. ``"equal"``: not one difference in all the episodes there were to be."""
    difference: float
    """In the mean: above 0 is better."""
    episodes: int
    """That it took."""
    margin: float

    @property
    def holds(self) -> bool:
        """True where the other tree earns as much, within the margin; where undecided, the mean decides."""
        return self.answer != "worse" and (self.answer != "undecided" or self.difference >= -self.margin)


def compare(
    differences: Differences,
    *,
    margin: float = 0.0,
    alpha: float = ALPHA,
    candidates: int = 1,
    first: int = FIRST,
    last: int = LAST,
) -> Comparison:
    """Look at the first 32 differences, 64, … until it is clear whether their mean is above ``-margin``.

    Raises:
        ValueError: a margin below 0, an ``alpha`` that is no chance, fewer than 2 episodes or candidates below 1.
    """
    _check(margin, alpha, candidates, first, last)
    numbers = interim_sizes(first, last)
    bound = upper_quantile(alpha / (len(numbers) * candidates), np.array(numbers) - 1)
    answer, mean = "equal", 0.0
    for number, factor in zip(numbers, bound.tolist(), strict=True):
        d = np.asarray(differences(number), np.float64)
        if not d.any():  # nothing differs yet
            continue
        mean, error = float(d.mean()), float(d.std(ddof=1)) / math.sqrt(number)
        if mean - factor * error > -margin:
            return Comparison("not worse", mean, number, margin)
        if mean + factor * error < -margin:
            return Comparison("worse", mean, number, margin)
        answer = "undecided"
    return Comparison(answer, mean, last, margin)


def compare_trees(scores: ReturnCache, tree: DecisionTree, other: DecisionTree, **how: float) -> Comparison:
    """Compare the returns of ``other`` with those of ``tree``; ``how`` and errors are those of `compare`."""

    def differences(number: int) -> Float[np.ndarray, " episodes"]:
        ours, theirs = (scores.of(each, number).astype(np.float64) for each in (tree, other))
        return theirs - ours

    return compare(differences, **how)  # pyright: ignore[reportArgumentType]


def interim_sizes(first: int, last: int) -> list[int]:
    """Return the numbers of episodes after which to look: ``first``, twice as many, …, ``last``."""
    numbers = [min(first, last)]
    while numbers[-1] < last:
        numbers.append(min(2 * numbers[-1], last))
    return numbers


def upper_quantile(chance: float, freedom: Shaped[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the quantile that Student's t exceeds with probability ``chance``, for each number of degrees of freedom.

    The expansion in powers of 1 / freedom (Abramowitz and Stegun, 26.7.5).
    """
    z = -NormalDist().inv_cdf(chance)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    powers = np.asarray(freedom, float)[:, None] ** -(1.0 + np.arange(len(terms)))
    return z + powers @ np.array(terms)


def _check(margin: float, alpha: float, candidates: int, first: int, last: int) -> None:
    if not 0 <= margin < math.inf:
        raise ValueError(f"margin must be a return, 0 or more, got {margin}")
    if not 0 < alpha < 0.5:
        raise ValueError(f"alpha must be a chance above 0 and below a half, got {alpha}")
    if candidates < 1:
        raise ValueError(f"candidates must be at least 1, got {candidates}")
    if not 2 <= first <= last:
        raise ValueError(
            f"a comparison needs 2 episodes at least, and no more at first than at last, got {first} and {last}"
        )


def successive_halving(
    scores: ReturnCache,
    tree: DecisionTree,
    others: Sequence[DecisionTree],
    *,
    keep: int,
    first: int,
    last: int,
    key: Callable[[float, int], Any] = lambda loss, _: loss,
) -> list[tuple[float, int]]:
    """Rank ``others`` by their loss against ``tree``; return the best as pairs of loss and position.

    Halving ends when at most ``keep`` are left or ``last`` episodes are played. Pairs are sorted by ``key`` of loss
    and position, the least first.
    """
    field = [(0.0, i) for i in range(len(others))]
    for number in interim_sizes(first, last):
        returns = scores.of_all([tree, *(others[i] for _, i in field)], number, like=tree)
        means = returns.mean(axis=1, dtype=np.float64)
        field = [(float(means[0] - mean), i) for mean, (_, i) in zip(means[1:], field, strict=True)]
        field.sort(key=lambda each: key(*each))
        if len(field) <= keep or number == last:
            break
        field = field[: max(keep, len(field) // 2)]
    return field
