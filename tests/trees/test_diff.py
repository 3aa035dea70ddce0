from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from sympol.trees import DecisionTree, DiscreteActions
from sympol.trees.boxes import space
from sympol.trees.diff import diff, regions
from sympol.trees.edit import cut, graft, set_action, set_feature, set_threshold, split_tree
from sympol.trees.override import override
from sympol.trees.verify.conditions import boxes_of
from sympol.trees.verify.grammar import parse_condition

from .samples import (
    ACTIONS,
    HOSTILE_NAMES,
    consistent,
    every_cell,
    random_grouped_tree,
    random_tree,
    within_bounds,
)

EIGHTHS = np.arange(-12, 13, dtype=np.float32) / 8
"""Numbers whose decimals are exact, so that what is said of them can be read as a condition of a property."""


def pairs():
    """Two trees of one space, and an observation in each cell of the grid of both, within the bounds."""
    for kind in ACTIONS:
        for seed in range(8):
            rng = np.random.default_rng(seed)
            one, other = (
                exact(random_tree(rng, ACTIONS[kind], depth=depth), rng) for depth in (3, 2 + seed % 2)
            )
            other = replace(other, feature_low=one.feature_low, feature_high=one.feature_high)
            yield one, other, cells(one, other)
            one = random_grouped_tree(rng, ACTIONS[kind], depth=3)
            shuffled = rng.permutation(np.flatnonzero(one.is_leaf))
            other = one
            for leaf in shuffled[:3]:
                other = set_action(other, int(leaf), one.actions.decide(one.value[[shuffled[-1]]])[0])
            other = set_threshold(other, 0, 0.5)
            yield one, other, cells(one, other)


def exact(tree: DecisionTree, rng: np.random.Generator) -> DecisionTree:
    inner = ~tree.is_leaf
    threshold, few = tree.threshold.copy(), rng.choice(EIGHTHS, 5)
    threshold[inner] = rng.choice(few, inner.sum())
    low = np.where(np.isfinite(tree.feature_low), -1.25, -np.inf)
    high = np.where(np.isfinite(tree.feature_high), 1.25, np.inf)
    return replace(tree, threshold=threshold, feature_low=low, feature_high=high, n_node_samples=None)


def cells(one: DecisionTree, other: DecisionTree) -> np.ndarray:
    both = [consistent(tree, every_cell(tree, nan=False)) for tree in (one, other)]
    x = np.concatenate(both)
    rng = np.random.default_rng(0)
    if not one.groups:  # any of the one in any combination with the other
        x = np.concatenate([x, *(rng.permuted(x, axis=0) for _ in range(3))])
    return within_bounds(one, x)


def words(tree: DecisionTree, x: np.ndarray) -> list[str]:
    return [", ".join(tree.actions.words(action)) for action in tree.predict(x)]


def test_regions_are_exactly_where_the_actions_differ():
    differing = 0
    for one, other, x in pairs():
        if not len(x):
            continue
        told = [[] for _ in x]
        for change in regions(one, other):
            here = holds(change.where, one, x)
            for i in np.flatnonzero(here):
                told[i].append((change.before, change.after))
        expected = list(zip(words(one, x), words(other, x), strict=True))
        assert [pair for pair in told if len(pair) > 1] == []
        assert [tuple(pair) for pair in told] == [(pair,) if pair[0] != pair[1] else () for pair in expected]
        assert diff(one, other).acts_alike == (not any(told))
        differing += sum(map(bool, told))
    assert differing > 1000


def holds(where: str, tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    if not where:
        return np.full(len(x), True)
    boxes = boxes_of(parse_condition(where, tree), space(tree, bounds=False))
    return boxes.contains(x).any(axis=0)


def test_where_two_trees_part_more_than_once_each_region_is_told_once():
    by_regions = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        parts = [exact(random_tree(rng, ACTIONS["discrete"], depth=2), rng) for _ in range(4)]
        bounds = {name: getattr(parts[0], name) for name in ("feature_low", "feature_high")}
        one = replace(split_tree(0, 0.125, parts[0], parts[1]), **bounds)
        other = replace(split_tree(0, 0.125, parts[2], parts[3]), **bounds)
        told = diff(one, other).changes
        assert len(told) == len({*told})
        if not any("“" in change.before + change.after for change in told):
            assert {*told} == {*regions(one, other)}
            by_regions += len(told)
    assert by_regions > 20


def test_visited_states_are_counted_by_what_they_got_and_get():
    for one, other, x in pairs():
        if not len(x):
            continue
        visited = diff(one, other, x).visited
        expected = Counter(
            pair for pair in zip(words(one, x), words(other, x), strict=True) if pair[0] != pair[1]
        )
        assert visited is not None
        assert dict(visited.counts) == expected
        assert list(visited.counts.values()) == sorted(expected.values(), reverse=True)
        assert visited.n_changed == sum(expected.values())
        assert visited.share == visited.n_changed / len(x)


def test_each_edit_is_told_as_it_was_made(cartpole):
    told = {
        set_threshold(cartpole, 1, 0.5): (
            "Where pole angular velocity ≤ -0.05: “pole angle ≤ 0.021” becomes “pole angle ≤ 0.5”.",
        ),
        set_feature(cartpole, 0, 0): (
            "Everywhere: “pole angular velocity ≤ -0.05” becomes “cart position ≤ -0.05”.",
        ),
        set_action(cartpole, 2, 1): (
            "Where pole angle ≤ 0.021 and pole angular velocity ≤ -0.05: push left becomes push right.",
        ),
        cut(cartpole, 1, 0): (
            "Where pole angular velocity ≤ -0.05: “pole angle ≤ 0.021” with 2 nodes below becomes push left.",
        ),
        graft(
            cartpole,
            2,
            DecisionTree.from_text("cart position > 1\n yes: push left\n no: push right", like=cartpole),
        ): (
            "Where pole angle ≤ 0.021 and pole angular velocity ≤ -0.05: push left becomes “cart position ≤ 1” with 2 "
            "nodes below.",
        ),
    }
    for edited, sentences in told.items():
        assert diff(cartpole, edited).sentences == sentences


def test_thresholds_that_training_moved_are_told_one_by_one(cartpole):
    moved = replace(cartpole, threshold=np.where(cartpole.is_leaf, -2, cartpole.threshold * 2))
    assert [(change.before, change.after) for change in diff(cartpole, moved).changes] == [
        ("“pole angular velocity ≤ -0.05”", "“pole angular velocity ≤ -0.1”"),
        ("“pole angle ≤ 0.021”", "“pole angle ≤ 0.042”"),
        ("“pole angle ≤ -0.1”", "“pole angle ≤ -0.2”"),
    ]


def test_a_forced_rule_is_told_by_what_it_changes(cartpole):
    forced, _ = override(cartpole, "pole angle > 0.25 and cart position > 1", "push left")
    where = "Where cart position > 1 and pole angle > 0.25 and pole angular velocity"
    assert diff(cartpole, forced).sentences == (
        f"{where} ≤ -0.05: push right becomes push left.",
        f"{where} > -0.05: push right becomes push left.",
    )


def test_what_changes_nothing_is_said_to():
    for one, _, _ in pairs():
        assert diff(one, one).sentences == ("Both act alike on every observation within the bounds.",)
        assert diff(one, one.prune()).acts_alike


def test_a_change_that_no_observation_sees_is_told_and_said_to_change_nothing(cartpole):
    out_of_bounds = set_threshold(cartpole, 4, 2.0)
    again = set_threshold(cartpole, 4, 3.0)
    said = diff(out_of_bounds, again).sentences
    assert said[0].startswith(
        "Where pole angular velocity > -0.05: “pole angle ≤ 2” becomes “pole angle ≤ 3”"
    )
    assert said[1] == "Both act alike on every observation within the bounds."


def test_whole_numbers_and_categories_are_told_as_such(front):
    front = replace(front, integers=(5,))
    before = DecisionTree.from_text("steps <= 3\n yes: turn left\n no: turn right", like=front)
    after = DecisionTree.from_text(
        "front is lava\n yes: turn left\n no: steps <= 3\n  yes: turn left\n  no: turn right", like=front
    )
    assert diff(before, after).sentences == (
        "Where front is lava and steps > 3: turn right becomes turn left.",
    )
    assert diff(after, before).to_dict() == {
        "changes": [{"where": "front is lava and steps > 3", "before": "turn left", "after": "turn right"}],
        "acts_alike": False,
    }


def test_strangers_names_stay_on_one_line():
    n = len(HOSTILE_NAMES)
    tree = DecisionTree.from_complete(
        np.arange(3), np.zeros(3), np.eye(n)[:4], actions=DiscreteActions(n, tuple(HOSTILE_NAMES)),
        feature_names=HOSTILE_NAMES,
    )  # fmt: skip
    for other in (set_action(tree, 2, 4), set_threshold(tree, 1, 1), cut(tree, 4)):
        for sentence in diff(tree, other, np.ones((2, n))).sentences:
            assert sentence.isprintable()


def test_trees_of_other_spaces_are_not_compared(cartpole, pendulum):
    with pytest.raises(ValueError, match="must be of the same features"):
        diff(cartpole, pendulum)
    with pytest.raises(ValueError, match=r"\[4\] or \[batch, 4\], got \[1, 3\]"):
        diff(cartpole, cartpole, [0, 0, 0])
