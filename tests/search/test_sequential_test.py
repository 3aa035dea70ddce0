"""Paired tests: how often they are wrong, how soon they are right, and what they make of ties."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import stats

from sympol.search.comparison import (
    ALPHA,
    Comparison,
    ReturnCache,
    compare,
    compare_trees,
    interim_sizes,
    upper_quantile,
)
from sympol.trees import DiscreteActions
from tests.search.bandit import Bandit
from tests.trees.samples import random_tree


def of(differences: np.ndarray, **how: float) -> Comparison:
    return compare(lambda number: differences[:number], last=len(differences), **how)  # pyright: ignore


@pytest.mark.parametrize("chance", [0.05, 1e-2, 1e-3, 1e-4, 1e-5])
def test_the_quantile_is_students(chance):
    freedom = np.array([15, 31, 63, 127, 1023])
    np.testing.assert_allclose(upper_quantile(chance, freedom), stats.t.isf(chance, freedom), rtol=4e-3)


NOISE = {
    "normal": lambda rng, shape: rng.normal(size=shape),
    "heavy": lambda rng, shape: rng.standard_t(3, size=shape),
    "mostly nothing": lambda rng, shape: (rng.random(shape) < 0.2) * rng.choice([-1.0, 1.0], shape),
}


@pytest.mark.parametrize("noise", NOISE)
def test_it_is_wrong_no_more_often_than_it_may_be(noise):
    """Where the mean is just the margin both answers are wrong; each comes in at most 5 % of the cases, at any look."""
    d = NOISE[noise](np.random.default_rng(0), (1000, 512)) - 0.5
    answers = [of(row, margin=0.5).answer for row in d]
    for wrong in ("worse", "not worse"):
        assert answers.count(wrong) / len(answers) <= ALPHA
    assert answers.count("undecided") > 900


def test_many_candidates_are_together_wrong_no_more_often():
    d = np.random.default_rng(1).normal(size=(200, 20, 256))
    wrong = [any(of(row, candidates=20).answer == "not worse" for row in family) for family in d]
    alone = [any(of(row).answer == "not worse" for row in family) for family in d]
    assert np.mean(wrong) <= ALPHA < 0.25 < np.mean(alone)


def test_rare_losses_are_seen_in_time():
    """A loss of 100 in one episode of fifty is no tie, though most first looks see none."""
    rng = np.random.default_rng(2)
    d = -100.0 * (rng.random((300, 1024)) < 0.02)
    found = [of(row) for row in d]
    assert sum((row[:32] == 0).all() for row in d) > 100
    assert not any(comparison.holds for comparison in found)


def test_what_is_clear_is_said_at_once():
    d = np.random.default_rng(3).normal(size=1024)
    assert of(d - 5)[::2] == ("worse", 32)
    assert of(d + 5)[::2] == ("not worse", 32)
    assert of(d - 5, margin=20)[::2] == ("not worse", 32)
    better, worse = of(d + 5), of(d - 5)
    assert better.holds
    assert not worse.holds
    assert better.difference == pytest.approx(d[:32].mean() + 5)


def test_no_difference_at_all_is_known_at_the_end_only():
    none = np.zeros(256)
    assert of(none) == Comparison("equal", 0.0, 256, 0.0)
    assert of(none).holds
    for at in (0, 255):
        once = none.copy()
        once[at] = -1e-3
        assert of(once) == Comparison("undecided", once.mean(), 256, 0.0)
        assert not of(once).holds
        assert of(once, margin=1e-3).holds  # what is not above the margin in the mean is not worse


def test_the_mean_decides_what_is_undecided():
    d = np.tile([1.0, -1.0], 128)
    d[0] += 0.1
    assert of(d).answer == of(-d).answer == "undecided"
    assert of(d).holds
    assert not of(-d).holds
    assert of(-d, margin=0.1).holds


def test_it_asks_for_ever_more_episodes_up_to_the_last():
    asked = []

    def differences(number: int) -> np.ndarray:
        asked.append(number)
        return np.tile([1.0, -1.0], 500)[:number]

    compare(differences, first=32, last=200)
    assert asked == interim_sizes(32, 200) == [32, 64, 128, 200]
    assert interim_sizes(8, 8) == [8]


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"margin": -1.0}, "margin must be a return, 0 or more, got -1.0"),
        ({"margin": np.nan}, "margin must be a return"),
        ({"alpha": 0.0}, "alpha must be a probability above 0 and below a half, got 0.0"),
        ({"candidates": 0}, "candidates must be at least 1, got 0"),
        ({"first": 1}, "a comparison needs 2 episodes at least"),
        ({"first": 64, "last": 32}, "no more at first than at last, got 64 and 32"),
    ],
)
def test_what_makes_no_sense_is_refused(how, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        compare(np.zeros, **how)


def test_trees_are_compared_in_the_same_episodes_which_each_plays_once():
    rng = np.random.default_rng(4)
    teacher, other = (random_tree(rng, DiscreteActions(3)) for _ in range(2))
    evaluator = Bandit(teacher)
    scores = ReturnCache(evaluator, first_episode=100)
    found = compare_trees(scores, teacher, other)
    episodes = range(100, 100 + found.episodes)
    assert found.answer == "worse"
    differences = evaluator.returns_of(other, episodes) - evaluator.returns_of(teacher, episodes)
    assert found.difference == pytest.approx(differences.mean())
    steps = evaluator.steps
    assert compare_trees(scores, teacher, other) == found
    assert evaluator.steps == steps
    assert compare_trees(scores, teacher, teacher.prune(bounds=False), last=64).answer == "equal"


def test_scores_are_those_of_playing_in_whatever_order_they_are_asked_for():
    rng = np.random.default_rng(5)
    trees = [random_tree(rng, DiscreteActions(3)) for _ in range(4)]
    evaluator = Bandit(trees[0])
    scores = ReturnCache(evaluator, 7)
    scores.of(trees[1], 3)
    scores.of_all([trees[2], trees[1], trees[2]], 5)
    want = [evaluator.returns_of(tree, range(7, 16)) for tree in trees]
    np.testing.assert_array_equal(scores.of_all(trees, 9), want)
    np.testing.assert_array_equal(scores.of(trees[3], 2), want[3][:2])
    played = sum(number * len(episodes) for number, episodes in evaluator.calls)
    assert played == 4 * 9


def test_scores_are_the_same_by_whomever_trees_are_like():
    rng = np.random.default_rng(6)
    trees = [random_tree(rng, DiscreteActions(3)) for _ in range(4)]
    evaluator = Bandit(trees[0])
    scores = ReturnCache(evaluator, 7)
    scores.of(trees[0], 6)  # further than the others have come
    scores.of_all(trees[:3], 2, like=trees[0])
    scores.of_all(trees[1:], 4, like=trees[1])
    want = [evaluator.returns_of(tree, range(7, 16)) for tree in trees]
    np.testing.assert_array_equal(scores.of_all(trees, 9, like=trees[0]), want)
