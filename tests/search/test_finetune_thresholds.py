"""Fine-tuning finds the numbers that are known to be best, and changes nothing else."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from sympol.search.budget import Budget
from sympol.search.finetune_thresholds import (
    FINAL_FACTOR,
    MAX_EPISODE_FACTOR,
    OBSERVED,
    REPORT_EVERY,
    SCHEDULE_WINDOW,
    EpisodeSchedule,
    TreeParameters,
    agreement,
    finetune_thresholds,
)
from sympol.trees import BoxActions, DecisionTree, DiscreteActions
from sympol.trees.groups import Group

from .bandit import LENGTH, Bandit

NAMES = ("a", "b", "c")


def tree_of(thresholds, values, actions) -> DecisionTree:
    """Three questions, about a, then b or c."""
    features = np.array([0, 1, 2])
    return DecisionTree.from_complete(
        features, np.array(thresholds, float), np.array(values, float), actions=actions, feature_names=NAMES
    )


CHOICES = np.eye(4)
TRUTH = tree_of([0.3, -0.5, 0.8], CHOICES, DiscreteActions(4))
OFF = tree_of([0.0, 0.2, 0.2], CHOICES, DiscreteActions(4))
ROBOT = BoxActions((-2.0,), (2.0,), (1,), names=("torque",))
AIMED = tree_of([0.3, -0.5, 0.8], [[-1.5], [-0.5], [0.25], [1.0]], ROBOT)
ASTRAY = tree_of([0.0, 0.2, 0.2], [[0.0]] * 4, ROBOT)


def mean(evaluator: Bandit, tree: DecisionTree) -> float:
    return float(evaluator.returns_of(tree, range(50_000, 51_000)).mean())


def test_thresholds_are_found_that_answer_as_the_best_tree_does():
    evaluator = Bandit(TRUTH)
    found = finetune_thresholds([OFF], evaluator, budget=Budget(steps=1_000_000))
    assert mean(evaluator, OFF) < 0.8 * LENGTH
    assert mean(evaluator, found) > 0.98 * LENGTH
    split = ~found.is_leaf
    np.testing.assert_allclose(found.threshold[split], TRUTH.threshold[split], atol=0.05)
    np.testing.assert_array_equal(found.feature, OFF.feature)
    np.testing.assert_array_equal(found.value, OFF.value)  # discrete answers stay


def test_answers_of_continuous_actions_are_found_with_the_thresholds():
    evaluator = Bandit(AIMED)
    found = finetune_thresholds([ASTRAY], evaluator, budget=Budget(steps=3_000_000))
    assert mean(evaluator, found) > 0.02 * mean(evaluator, ASTRAY)  # both are below zero
    np.testing.assert_allclose(found.value[found.is_leaf], AIMED.value[AIMED.is_leaf], atol=0.1)


def test_what_is_best_already_stays_to_the_bit():
    assert finetune_thresholds([TRUTH], Bandit(TRUTH), budget=Budget(steps=100_000)) is TRUTH


def test_the_same_seed_gives_the_same_tree_and_numpy_s_own_generator_is_left_alone():
    np.random.seed(7)  # noqa: NPY002
    trees = [
        finetune_thresholds([OFF], Bandit(TRUTH), budget=Budget(steps=200_000), seed=seed)
        for seed in (0, 0, 1)
    ]
    assert trees[0] == trees[1]
    assert trees[0] != trees[2]
    assert np.random.random() == np.random.RandomState(7).random()  # noqa: NPY002


def test_a_generation_shares_its_episodes_and_no_two_generations_do():
    evaluator, told = Bandit(AIMED), []
    finetune_thresholds(
        [ASTRAY], evaluator, budget=Budget(steps=300_000), episodes=8, first_episode=100, progress=told.append
    )
    *generations, last = [episodes for _, episodes in evaluator.calls]
    numbers = [len(episodes) for episodes in generations]
    assert generations[0].start == 100 + OBSERVED
    assert numbers[:SCHEDULE_WINDOW] == [8] * SCHEDULE_WINDOW
    for one, next_one in zip(generations, [*generations[1:], last], strict=True):
        assert next_one.start == one.stop
    assert len(last) == FINAL_FACTOR * numbers[-1]
    assert len(told) == len(generations) // REPORT_EVERY
    assert told[0].steps == OBSERVED * LENGTH + sum(
        number * 8 * LENGTH for number, _ in evaluator.calls[:REPORT_EVERY]
    )
    generation = evaluator.calls[0][0] * numbers[-1] * LENGTH
    assert 300_000 <= evaluator.steps - 2 * len(last) * LENGTH < 300_000 + generation


def test_halves_agree_as_far_as_trees_differ_by_more_than_their_luck():
    rng = np.random.default_rng(0)
    skill, luck = rng.normal(size=(2000, 1)), rng.normal(size=(2000, 32))
    assert agreement(skill + luck) == pytest.approx(
        1 / (1 + 1 / 16), abs=0.02
    )  # each half has a variance of 1/16
    assert agreement(luck) == pytest.approx(0, abs=0.05)
    assert agreement(np.full((14, 8), 500.0)) == 1.0


def test_where_halves_hardly_agree_there_are_more_episodes_and_where_they_do_fewer():
    rng = np.random.default_rng(0)
    schedule = EpisodeSchedule(8)
    numbers = []
    for difference in (0.0, 0.0, 0.0, 10.0, 10.0):
        for _ in range(SCHEDULE_WINDOW):
            assert not numbers or schedule.episodes == numbers[-1]
            rows = difference * rng.normal(size=(20, 1)) + rng.normal(size=(20, schedule.episodes))
            schedule.update([rows, rows])
        numbers.append(schedule.episodes)
    assert numbers == [16, 8 * MAX_EPISODE_FACTOR, 8 * MAX_EPISODE_FACTOR, 16, 8]


def test_episodes_too_few_to_halve_are_refused():
    with pytest.raises(ValueError, match="at least 2 episodes, got 1"):
        finetune_thresholds([OFF], Bandit(TRUTH), budget=Budget(steps=1000), episodes=1)


def test_a_step_of_one_is_the_spread_of_what_is_asked_about_or_half_a_range():
    seen = np.array([[0, 1, 5], [2, 1, 9]], np.float32)  # b never differs
    numbers = TreeParameters.of(ASTRAY, seen)
    questions = np.flatnonzero(~ASTRAY.is_leaf)
    np.testing.assert_array_equal(numbers.splits, questions[ASTRAY.feature[questions] != 1])
    shifted = numbers.shifted(np.array([1, -2, 0, 0, 0, 0.5]))
    assert dict(
        zip(shifted.feature[questions].tolist(), shifted.threshold[questions].tolist(), strict=True)
    ) == {
        0: 0.0 + 1 * 1,
        1: pytest.approx(0.2),
        2: pytest.approx(0.2 - 2 * 2),
    }
    assert shifted.value[shifted.is_leaf].ravel().tolist() == [0, 0, 0, 0.5 * 2]
    assert numbers.shifted(np.zeros(6)) == ASTRAY


def test_unbounded_actions_move_by_one():
    free = replace(ASTRAY, actions=BoxActions((-np.inf,), (2.0,), (1,), names=("torque",)))
    assert TreeParameters.of(free, np.eye(3, dtype=np.float32)).scale[-4:].tolist() == [1.0] * 4


def test_categories_and_trees_without_a_number_do_not_move():
    one_hot = replace(OFF, groups=(Group("which", (0, 1, 2), ("x", "y", "z")),))
    evaluator = Bandit(TRUTH)
    assert TreeParameters.of(one_hot, np.eye(3, dtype=np.float32)).size == 0
    evaluator.seen_in = lambda episodes: np.eye(3, dtype=np.float32)
    assert finetune_thresholds([one_hot], evaluator, budget=Budget(steps=10_000)) is one_hot
    assert not evaluator.calls


def test_where_nothing_is_left_to_gain_it_ends():
    evaluator = Bandit(TRUTH)
    evaluator.returns_of = lambda tree, episodes: np.full(len(episodes), 500, np.float32)
    assert finetune_thresholds([OFF], evaluator, budget=Budget()) is OFF  # no budget would end it


def test_of_several_trees_those_go_on_that_can_be_made_more_of():
    """The tree with the wrong features is better at first, and worse once both are fine-tuned."""
    wrong = replace(OFF, feature=np.where(OFF.feature == 0, 2, OFF.feature))  # never asks about a
    poor = tree_of([1.2, 1.0, -1.0], CHOICES, DiscreteActions(4))
    evaluator = Bandit(TRUTH)
    assert mean(evaluator, wrong) > mean(evaluator, poor)
    found = finetune_thresholds([wrong, poor, wrong, wrong], evaluator, budget=Budget(steps=1_000_000))
    assert mean(evaluator, found) > 0.95 * LENGTH
    together = [number for number, _ in evaluator.calls[:-1]]
    assert together == sorted(together, reverse=True)
    assert {round(number / together[-1]) for number in together} == {4, 2, 1}
    steps = np.cumsum([number * len(episodes) * LENGTH for number, episodes in evaluator.calls])
    assert steps[together.count(together[0]) - 1] == pytest.approx(250_000, abs=20_000)


def test_one_number_alone_can_be_polished():
    one = DecisionTree.from_complete(
        np.array([0]), np.array([0.9]), np.eye(2), actions=DiscreteActions(2), feature_names=NAMES
    )
    truth = replace(one, threshold=np.where(one.is_leaf, one.threshold, np.float32(-0.4)))
    found = finetune_thresholds([one], Bandit(truth), budget=Budget(steps=300_000))
    np.testing.assert_allclose(found.threshold, truth.threshold, atol=0.05)


def test_without_a_budget_nothing_moves():
    evaluator = Bandit(TRUTH)
    assert finetune_thresholds([OFF], evaluator, budget=Budget(steps=0)) is OFF
    assert finetune_thresholds([OFF], evaluator, budget=Budget(seconds=0)) is OFF
    assert not evaluator.calls


def test_without_pycma_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(ImportError, match=r"pip install 'sympol\[bench\]'"):
        finetune_thresholds([OFF], Bandit(TRUTH), budget=Budget(steps=1))
