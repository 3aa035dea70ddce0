"""Thresholds with as few digits as cost nothing: 0.03 says as much as 0.029837415, and more to a reader.

Two things cost nothing. A threshold may lie anywhere between the two values next to it that were seen at its node: no
observation of these episodes changes sides. And where that leaves it long, fewer digits are tried by playing, node by
node: they stay where a paired test finds no less of a return than the tree had that was given (`compare_trees`). So
with the answers of continuous actions, each rounding of which acts otherwise.

What is rounded is the decimal; the tree compares with the float32 nearest to it, which reads as that decimal again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

import numpy as np
from jaxtyping import Float32

from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.floats import flushed, shortest
from .comparison import ReturnCache, compare_trees
from .evaluators.base import Evaluator
from .prune_by_return import Effort, default_effort


def round_thresholds(
    tree: DecisionTree,
    evaluator: Evaluator,
    *,
    margin: float = 0.0,
    first_episode: int = 0,
    effort: Effort | None = None,
) -> DecisionTree:
    """Round the thresholds of a tree, and its leaf outputs where actions are continuous.

    Splits that are decided then, as what is above them asks the same now, are pruned. Questions about one-hot features
    stay: readers are told the category.

    Args:
        tree: The tree to round.
        evaluator: The evaluator that plays the trees.
        margin: The return that all the rounding together may cost.
        first_episode: The first episode that is played; ``effort.last`` are played from there on.
        effort: How much is played in a step; by default by the kind of evaluator.

    Returns:
        The rounded tree, pruned exactly.

    Raises:
        ValueError: a margin below 0, or a tree for other features or actions.
    """
    effort = effort or default_effort(evaluator)
    scores = ReturnCache(evaluator, first_episode)
    how = {"margin": margin, "first": effort.first, "last": effort.last}
    rounded = _unnoticed(tree, evaluator.observe(tree, range(first_episode, first_episode + effort.last)))
    given = rounded  # not one action differs in these episodes, so it earns what the tree does

    def costs_nothing(candidate: DecisionTree) -> bool:
        return compare_trees(scores, given, candidate, **how).holds

    for node in _numbers(tree):
        for threshold in _shorter(float(rounded.threshold[node])):
            candidate = _with_threshold(rounded, node, threshold)
            if costs_nothing(candidate):
                rounded = candidate
                break
    if isinstance(tree.actions, BoxActions):
        for leaf in np.flatnonzero(tree.is_leaf).tolist():
            for candidate in _shorter_answers(rounded, leaf):
                if costs_nothing(candidate):
                    rounded = candidate
                    break
    return rounded.prune()


def digits_of(x: float) -> int:
    """Significant digits that a float32 needs to be told from all others; 0 needs none."""
    number = Decimal(repr(shortest(x))).normalize()
    return len(number.as_tuple().digits) if number else 0


def _numbers(tree: DecisionTree) -> list[int]:
    """The splits that ask about a number."""
    return [n for n in np.flatnonzero(~tree.is_leaf).tolist() if int(tree.feature[n]) not in tree.group_of]


def _unnoticed(tree: DecisionTree, seen: Float32[np.ndarray, "steps features"]) -> DecisionTree:
    """With the fewest digits that send all observations the same way, of equally many the nearest.

    And with answers as they are given: what lies beyond the bounds of actions is done at them.
    """
    if isinstance(tree.actions, BoxActions):
        answers = tree.leaf_actions.reshape(tree.leaf_outputs.shape)
        tree = replace(tree, value=np.where(tree.is_leaf[:, None], answers, 0), n_node_samples=None)
    come_by = tree.decision_path(seen).T
    for node in _numbers(tree):
        threshold = float(tree.threshold[node])
        x = seen[come_by[node], tree.feature[node]]
        low = float(x[x <= threshold].max(initial=-np.inf))
        high = float(x[x > threshold].min(initial=np.inf))
        short = next((t for t in _shorter(threshold) if low <= float(np.float32(t)) < high), threshold)
        tree = _with_threshold(tree, node, short)
    return tree


def _shorter(x: float) -> Iterator[float]:
    """Numbers near x with fewer digits: those with the fewest first, of equally many the nearest first."""
    exact = shortest(x)
    if exact:
        yield 0.0
    for digits in range(1, digits_of(x)):
        ends = [Context(prec=digits, rounding=way).create_decimal(repr(exact)) for way in _WAYS]
        yield from sorted((float(end) for end in ends), key=lambda end: abs(end - exact))


_WAYS = (ROUND_FLOOR, ROUND_CEILING)


def _with_threshold(tree: DecisionTree, node: int, threshold: float) -> DecisionTree:
    thresholds = tree.threshold.copy()
    thresholds[node] = flushed(threshold)
    return replace(tree, threshold=thresholds, n_node_samples=None)


def _shorter_answers(tree: DecisionTree, leaf: int) -> Iterator[DecisionTree]:
    """With the answer of a leaf rounded to no digit, to one, …."""
    answer = tree.leaf_outputs[leaf].tolist()
    for digits in range(max(map(digits_of, answer))):
        value = tree.leaf_outputs.copy()
        value[leaf] = [float(f"{shortest(x):.{digits - 1}e}") if digits else 0.0 for x in answer]
        yield replace(tree, value=value, n_node_samples=None)
