"""Round thresholds to as few digits as cost no return: 0.03 in place of 0.029837415.

A threshold may lie anywhere between the two observed values next to it at its node: no observation of these episodes
changes sides. Where that leaves many digits, fewer are tried by playing, node by node: they stay where a paired test
finds no loss of return against the given tree (`compare_trees`). The same holds for continuous actions, each rounding
of which changes what the tree does.

The decimal is what is rounded; the tree compares with the float32 nearest to it, which prints as that decimal again.
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

    Splits that became redundant, because one above them now has the same threshold, are pruned. Splits on one-hot
    features stay: they are shown as categories.

    Args:
        tree: The tree to round.
        evaluator: The evaluator that plays the trees.
        margin: The return that all roundings together may cost.
        first_episode: The first episode that is played; ``effort.last`` are played from there on.
        effort: How much is played in a step; by default by the kind of evaluator.

    Returns:
        The rounded tree, pruned exactly.

    Raises:
        ValueError: A margin below 0, or a tree for other features or actions.
    """
    effort = effort or default_effort(evaluator)
    scores = ReturnCache(evaluator, first_episode)
    how = {"margin": margin, "first": effort.first, "last": effort.last}
    rounded = _round_within_gaps(
        tree, evaluator.observe(tree, range(first_episode, first_episode + effort.last))
    )
    original = rounded  # no action differs in these episodes, so its return is that of the tree

    def costs_nothing(candidate: DecisionTree) -> bool:
        return compare_trees(scores, original, candidate, **how).holds

    for node in _numeric_splits(tree):
        for threshold in _shorter(float(rounded.threshold[node])):
            candidate = _with_threshold(rounded, node, threshold)
            if costs_nothing(candidate):
                rounded = candidate
                break
    if isinstance(tree.actions, BoxActions):
        for leaf in np.flatnonzero(tree.is_leaf).tolist():
            for candidate in _shorter_actions(rounded, leaf):
                if costs_nothing(candidate):
                    rounded = candidate
                    break
    return rounded.prune()


def digits_of(x: float) -> int:
    """Return the significant digits that tell a float32 from all others.

    Args:
        x: The number.

    Returns:
        How many digits; none for 0.
    """
    number = Decimal(repr(shortest(x))).normalize()
    return len(number.as_tuple().digits) if number else 0


def _numeric_splits(tree: DecisionTree) -> list[int]:
    """Return the splits on numeric features."""
    return [n for n in np.flatnonzero(~tree.is_leaf).tolist() if int(tree.feature[n]) not in tree.group_of]


def _round_within_gaps(tree: DecisionTree, seen: Float32[np.ndarray, "steps features"]) -> DecisionTree:
    """Use the fewest digits that send all observations to the same side, of equally many the nearest number.

    Continuous actions are clipped to their bounds, as the environment does.
    """
    if isinstance(tree.actions, BoxActions):
        actions = tree.leaf_actions.reshape(tree.leaf_outputs.shape)
        tree = replace(tree, value=np.where(tree.is_leaf[:, None], actions, 0), n_node_samples=None)
    reaches = tree.decision_path(seen).T
    for node in _numeric_splits(tree):
        threshold = float(tree.threshold[node])
        x = seen[reaches[node], tree.feature[node]]
        low = float(x[x <= threshold].max(initial=-np.inf))
        high = float(x[x > threshold].min(initial=np.inf))
        short = next((t for t in _shorter(threshold) if low <= float(np.float32(t)) < high), threshold)
        tree = _with_threshold(tree, node, short)
    return tree


def _shorter(x: float) -> Iterator[float]:
    """Yield numbers near x with fewer digits: those with the fewest first, of equally many the nearest first."""
    exact = shortest(x)
    if exact:
        yield 0.0
    for digits in range(1, digits_of(x)):
        ends = [Context(prec=digits, rounding=mode).create_decimal(repr(exact)) for mode in _ROUNDINGS]
        yield from sorted((float(end) for end in ends), key=lambda end: abs(end - exact))


_ROUNDINGS = (ROUND_FLOOR, ROUND_CEILING)


def _with_threshold(tree: DecisionTree, node: int, threshold: float) -> DecisionTree:
    thresholds = tree.threshold.copy()
    thresholds[node] = flushed(threshold)
    return replace(tree, threshold=thresholds, n_node_samples=None)


def _shorter_actions(tree: DecisionTree, leaf: int) -> Iterator[DecisionTree]:
    """Yield the tree with the action of a leaf rounded to no digit, to one, …."""
    action = tree.leaf_outputs[leaf].tolist()
    for digits in range(max(map(digits_of, action))):
        value = tree.leaf_outputs.copy()
        value[leaf] = [float(f"{shortest(x):.{digits - 1}e}") if digits else 0.0 for x in action]
        yield replace(tree, value=value, n_node_samples=None)
