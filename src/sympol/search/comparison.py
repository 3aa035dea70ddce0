"""Compare trees on shared episodes, with as few episodes as necessary.

All trees play the same numbered episodes, so only the paired differences matter. A `ReturnCache` plays no tree
twice in an episode. `compare` tests after 32 episodes, 64, 128, … whether the mean difference is above ``-margin`` or
below, by a pair of one-sided t-tests. Repeated tests and many candidates find something by chance more often, so the
allowed error ``alpha`` is divided by the number of tests and of candidates (Bonferroni's inequality; Dunn, "Multiple
comparisons among means", 1961). That holds however these depend on each other, and is conservative, as they have much
in common. (Group-sequential designs such as Pocock's of 1977 are sharper, for normal differences.)

The t-test is only approximate for differences far from normal. The usual worst case is a change that matters in one
episode of a hundred and in none of the first. So episodes in which nothing differs decide nothing: while there are no
others, the next test is awaited, up to the last.

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
    """The returns of trees in shared episodes, each played once.

    Args:
        evaluator: The evaluator that plays the trees.
        first_episode: The number of the first episode.
    """

    def __init__(self, evaluator: Evaluator, first_episode: int = 0) -> None:
        self.evaluator, self.first_episode = evaluator, first_episode
        self._known: dict[DecisionTree, Float32[np.ndarray, " episodes"]] = {}

    def of(self, tree: DecisionTree, number: int) -> Float32[np.ndarray, " episodes"]:
        """Return the returns of one tree.

        Args:
            tree: The tree.
            number: The number of episodes, counted from the first.

        Returns:
            Its returns ``[episodes]``.
        """
        return self.of_all([tree], number)[0]

    def of_all(
        self, trees: Sequence[DecisionTree], number: int, *, like: DecisionTree | None = None
    ) -> Float32[np.ndarray, "trees episodes"]:
        """Return the returns of many trees; those that are missing are played in one batch.

        Args:
            trees: The trees.
            number: The number of episodes, counted from the first.
            like: A tree of which the others are variants, if there is one: see `Evaluator.play_variants`.

        Returns:
            Their returns ``[trees, episodes]``.
        """
        by_played: dict[int, dict[DecisionTree, None]] = {}
        for tree in trees:
            played = len(self._known.get(tree, ()))
            if played < number:
                by_played.setdefault(played, {})[tree] = None
        for played, missing in by_played.items():
            episodes = range(self.first_episode + played, self.first_episode + number)
            playing = [tree for tree in missing if tree != like]
            if like is None:
                returns = self.evaluator.play(playing, episodes).returns
            else:
                returns = self.evaluator.play_variants(like, playing, episodes).returns
                playing.insert(0, like)
            for tree, new in zip(playing, returns, strict=True):
                if tree in missing:
                    known = self._known[tree] if played else new[:0]
                    self._known[tree] = np.concatenate([known, new])
        return np.stack([self._known[tree][:number] for tree in trees])


FIRST, LAST = 32, 1024
"""Episodes of the first test, and of the last."""
ALPHA = 0.05
"""The allowed probability of a wrong answer, of "worse" and of "not worse" each."""

Answer: TypeAlias = Literal["worse", "not worse", "equal", "undecided"]
Differences: TypeAlias = Callable[[int], Shaped[np.ndarray, " episodes"]]
"""A function from a number of episodes to the differences of returns in them."""


class Comparison(NamedTuple):
    """The result of a comparison."""

    answer: Answer
    """``"worse"``: by more than the margin. ``"equal"``: no difference in any of the episodes."""
    difference: float
    """The mean difference: above 0 is better."""
    episodes: int
    """The number of episodes that were necessary."""
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
    """Test the first 32 differences, 64, … until it is clear whether their mean is above ``-margin``.

    Args:
        differences: Returns the differences in the first so many episodes.
        margin: The loss that is allowed.
        alpha: The allowed probability of a wrong answer.
        candidates: The number of comparisons that share it.
        first: Episodes of the first test.
        last: Episodes of the last test.

    Returns:
        The answer, and the mean difference.

    Raises:
        ValueError: A margin below 0, an ``alpha`` that is no probability, fewer than 2 episodes, or no candidates.
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
    """Compare the returns of two trees.

    Args:
        scores: The returns of trees so far.
        tree: The tree to compare with.
        other: The tree that may be worse or not.
        **how: Further arguments of `compare`.

    Returns:
        The answer about ``other``, and the mean difference.

    Raises:
        ValueError: As `compare` does.
    """

    def differences(number: int) -> Float[np.ndarray, " episodes"]:
        ours, theirs = (scores.of(each, number).astype(np.float64) for each in (tree, other))
        return theirs - ours

    return compare(differences, **how)  # pyright: ignore[reportArgumentType]


def interim_sizes(first: int, last: int) -> list[int]:
    """Return the numbers of episodes after which to test.

    Args:
        first: The first number.
        last: The last one.

    Returns:
        ``first``, twice as many, …, ``last``.
    """
    numbers = [min(first, last)]
    while numbers[-1] < last:
        numbers.append(min(2 * numbers[-1], last))
    return numbers


def upper_quantile(chance: float, freedom: Shaped[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return quantiles of Student's t, by the expansion in powers of 1 / freedom (Abramowitz and Stegun, 26.7.5).

    Args:
        chance: The probability with which t exceeds the quantile.
        freedom: Degrees of freedom ``[n]``.

    Returns:
        The quantiles ``[n]``.
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
        raise ValueError(f"alpha must be a probability above 0 and below a half, got {alpha}")
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
    """Rank variants of a tree by their loss; the better half of them plays twice as many episodes, and so on.

    Args:
        scores: The returns of trees so far.
        tree: The tree.
        others: Its variants.
        keep: Halving ends when at most so many are left.
        first: Episodes that all variants play.
        last: Halving ends when so many episodes are played.
        key: What to sort by, the least first: a function of a variant's loss and its position in ``others``.

    Returns:
        The best variants, as pairs of loss and position, sorted by ``key``.
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
