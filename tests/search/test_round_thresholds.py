"""Rounding: as short as can be between what was seen, and shorter where playing says that it costs nothing."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest

from sympol.search.prune_by_return import Effort
from sympol.search.round_thresholds import digits_of, round_thresholds
from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group
from sympol.trees.edit import graft
from sympol.trees.floats import shortest
from tests.search.bandit import Bandit
from tests.trees.samples import ACTIONS, random_tree

QUICK = Effort(candidates=100, first=8, last=32, watched=16)


def drawn(seed: int, kind: str = "discrete", depth: int = 3) -> DecisionTree:
    tree, nowhere = random_tree(np.random.default_rng(seed), ACTIONS[kind], depth), np.full(3, np.inf)
    return replace(tree, feature_low=-nowhere, feature_high=nowhere, n_node_samples=None)


def split(threshold: float, *, groups: tuple[Group, ...] = ()) -> DecisionTree:
    nodes = np.array([1, -1, -1]), np.array([2, -1, -1]), np.array([0, -2, -2])
    return DecisionTree(
        *nodes,
        threshold=np.float32([threshold, -2, -2]),
        value=np.float32([[0, 0], [1, 0], [0, 1]]),
        actions=DiscreteActions(2),
        feature_names=("a", "b"),
        feature_low=np.full(2, -np.inf),
        feature_high=np.full(2, np.inf),
        groups=groups,
    )


@pytest.mark.parametrize(
    ("x", "digits"),
    [(0, 0), (3, 1), (-0.5, 1), (100, 1), (0.1, 1), (0.12, 2), (-1234, 4), (1 / 3, 8), (1e-30, 1)],
)
def test_digits_are_those_that_a_reader_sees(x, digits):
    assert digits_of(x) == digits
    assert len(Decimal(repr(shortest(x))).normalize().as_tuple().digits) == max(digits, 1)


@pytest.mark.parametrize("kind", ACTIONS)
@pytest.mark.parametrize("seed", range(3))
def test_it_earns_as_much_with_no_more_digits(kind, seed):
    tree = drawn(seed, kind)
    evaluator = Bandit(tree, seed)
    rounded = round_thresholds(tree, evaluator, effort=QUICK)
    assert evaluator.returns_of(rounded, range(32)).mean() >= evaluator.returns_of(tree, range(32)).mean()
    before, after = (
        sum(digits_of(x) for x in each.threshold[~each.is_leaf].tolist()) for each in (tree, rounded)
    )
    assert after < before / 2
    assert rounded.n_nodes <= tree.n_nodes
    assert round_thresholds(tree, Bandit(tree, seed), effort=QUICK) == rounded


def test_no_shorter_number_lies_between_what_was_seen():
    """Against all numbers of fewer digits, where sides that change cost something: the teacher is the tree itself."""
    checked = 0
    for seed in range(6):
        tree = split(float(np.random.default_rng(seed).normal()))
        evaluator = Bandit(tree, seed)
        rounded = round_thresholds(tree, evaluator, effort=QUICK)
        x = evaluator.seen_in(range(32))[:, 0]
        t, short = float(tree.threshold[0]), float(rounded.threshold[0])
        low, high = x[x <= t].max(), x[x > t].min()
        assert low <= short < high
        digits = digits_of(short)
        assert digits <= 5
        for exponent in range(-6, 2):
            numbers = np.arange(-(10 ** (digits - 1)) + 1, 10 ** (digits - 1)) * 10.0**exponent
            assert not ((low <= numbers) & (numbers < high)).any()
            checked += numbers.size
    assert checked > 100


def test_what_was_meant_is_found():
    assert round_thresholds(split(0.49998), Bandit(split(0.5)), effort=QUICK).threshold[0] == np.float32(0.5)
    text = round_thresholds(split(0.1000321), Bandit(split(0.1)), effort=QUICK).to_text()
    assert "a ≤ 0.1\n" in text
    assert round_thresholds(split(1e-5), Bandit(split(0)), effort=QUICK).threshold[0] == 0


def test_fewer_digits_are_played_for():
    """Sides change, and nobody is the worse for it: both answers are as good, or the teacher's is the rounder one."""
    tree = split(0.4444444)
    alike = Bandit(replace(tree, value=np.float32([[0, 0], [1, 0], [1, 0]])))
    assert digits_of(float(round_thresholds(tree, Bandit(tree), effort=QUICK).threshold[0])) >= 2
    same = replace(tree, value=np.float32([[0, 0], [1, 0], [2, 1]]))
    assert round_thresholds(same, alike, effort=QUICK).n_nodes == 1  # nothing depends on the question
    assert round_thresholds(tree, Bandit(split(0.4)), effort=QUICK).threshold[0] == np.float32(0.4)


def test_what_rounding_decides_is_pruned():
    """Two questions that become the same question."""
    leaves = np.float32([[1, 0], [0, 1], [1, 0]])
    tree = graft(split(0.30001), 1, replace(split(0.29999), value=np.float32([[0, 0], [1, 0], [0, 1]])))
    assert tree.n_nodes == 5
    tree = replace(tree, value=np.concatenate([np.zeros((2, 2)), leaves]))
    rounded = round_thresholds(tree, Bandit(tree), effort=QUICK)
    assert rounded.n_nodes == 1  # between the two was nobody, and on both sides the answer is the same
    other = replace(tree, value=np.concatenate([np.zeros((2, 2)), np.float32([[1, 0], [0, 1], [0, 1]])]))
    assert round_thresholds(other, Bandit(other), effort=QUICK).threshold[0] == np.float32(0.3)


def test_a_margin_allows_more():
    tree = split(0.4444444)
    exact, rough = (round_thresholds(tree, Bandit(tree), margin=m, effort=QUICK) for m in (0.0, 20.0))
    assert digits_of(float(rough.threshold[0])) == 0 < digits_of(float(exact.threshold[0]))
    with pytest.raises(ValueError, match="margin must be a return"):
        round_thresholds(tree, Bandit(tree), margin=-1.0, effort=QUICK)


def test_categories_stay_as_they_are():
    class OneHot(Bandit):
        def seen_in(self, episodes: range) -> np.ndarray:
            return np.eye(2, dtype=np.float32)[(super().seen_in(episodes)[:, 0] > 0).astype(int)]

    tree = split(0.4444444, groups=(Group("which", (0, 1), ("a", "b")),))
    assert round_thresholds(tree, OneHot(tree), effort=QUICK) == tree


def test_answers_of_continuous_actions_are_rounded_and_stay_within_bounds():
    actions = BoxActions((-1,), (1,), (1,))
    exact = DecisionTree.from_complete(
        np.array([0]), np.array([0.3]), np.float32([[0.25], [-0.5]]), actions=actions
    )
    tree = replace(exact, value=np.float32([[0], [0.2500013], [-0.4999987]]))
    rounded = round_thresholds(tree, Bandit(exact), effort=QUICK)
    np.testing.assert_array_equal(rounded.value, exact.value)
    beyond = replace(tree, value=np.float32([[0], [7.654321], [-0.4999987]]))
    teacher = replace(exact, value=np.float32([[0], [1], [-0.5]]))
    assert round_thresholds(beyond, Bandit(teacher), effort=QUICK).value[1] == 1


def test_a_threshold_does_not_reach_the_value_above_it():
    """What was seen are tenths: of 0.4 and 0.5 only the one goes left at 0.46, so that 0.5 is another question."""
    tree = split(0.46)
    assert round_thresholds(tree, Bandit(tree, whole=True), effort=QUICK).threshold[0] == np.float32(0.4)
