"""Conditions on numbers, and the boxes of observations in which they hold.

A condition is built of closed intervals of float32 numbers, joined by and, or and not. The same conditions speak of
observations, where they become boxes that are sent down a tree, and of actions, of which each leaf has only one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, final

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, check_size
from ..floats import flushed, next_above, next_below

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32, Int

_MAX_BOXES = 1_000
"""Boxes of one condition; nobody writes a condition of more by hand."""


@final
@dataclass(frozen=True)
class Between:
    """The number at a position is from ``low`` to ``high``, both included and both float32; it is not NaN."""

    position: int
    low: float
    high: float


@final
@dataclass(frozen=True)
class All:
    """All parts hold; without parts it always holds."""

    parts: tuple[Condition, ...] = ()


@final
@dataclass(frozen=True)
class Any:
    """At least one part holds; without parts it never holds."""

    parts: tuple[Condition, ...] = ()


@final
@dataclass(frozen=True)
class Not:
    """The part does not hold. The opposite of a comparison is a comparison: NaN meets neither."""

    part: Condition


Condition: TypeAlias = Between | All | Any | Not
ALWAYS = All()


def interval(relation: str, number: Decimal) -> tuple[float, float]:
    """Return the lowest and the highest float32 x for which ``x relation number``.

    A rule that says ``x > 0.1`` means the real number 0.1, which is no float32. The comparison is made in decimals, so
    that nothing is rounded. -inf is less and inf greater than any number.

    Args:
        relation: ``<``, ``<=``, ``>``, ``>=`` or ``=``.
        number: A finite decimal number.

    Returns:
        Both ends, included; the lowest exceeds the highest if there is no such x.

    Raises:
        ValueError: If the relation is unknown.
    """
    match relation:
        case "<":
            return -math.inf, _highest(lambda x: x < number, number)
        case "<=":
            return -math.inf, _highest(lambda x: x <= number, number)
        case ">":
            return _lowest(lambda x: x > number, number), math.inf
        case ">=":
            return _lowest(lambda x: x >= number, number), math.inf
        case "=":
            return _lowest(lambda x: x >= number, number), _highest(lambda x: x <= number, number)
    raise ValueError(f"unknown relation {relation!r}; use <, <=, >, >= or =")


def _lowest(holds: Callable[[Decimal], bool], number: Decimal) -> float:
    """Return the lowest float32 for which ``holds``, which turns from false to true once, near ``number``."""
    x = flushed(float(number))
    while holds(_decimal(below := next_below(x))) and below != x:
        x = below
    while not holds(_decimal(x)):
        x = next_above(x)
    return float(x)


def _highest(holds: Callable[[Decimal], bool], number: Decimal) -> float:
    # copy_negate, because a minus rounds to 28 digits
    return -_lowest(lambda x: holds(x.copy_negate()), number.copy_negate())


def _decimal(x: np.ndarray) -> Decimal:
    return Decimal(float(x))


def satisfied(
    condition: Condition, numbers: Float[np.ndarray, "batch n"], *, negated: bool = False
) -> Bool[np.ndarray, " batch"]:
    """Return for which rows a condition is true.

    Args:
        condition: The condition; its positions are columns.
        numbers: One set of numbers a row.
        negated: Whether its opposite is meant.
    """
    match condition:
        case Not(part):
            return satisfied(part, numbers, negated=not negated)
        case Between(position, low, high):
            x = numbers[:, position]
            return ((x < low) | (x > high)) if negated else ((low <= x) & (x <= high))
        case All(parts) | Any(parts):
            each = [satisfied(part, numbers, negated=negated) for part in parts]
            join = np.logical_and if isinstance(condition, All) != negated else np.logical_or
            return join.reduce([np.full(len(numbers), join is np.logical_and), *each])


def boxes_of(condition: Condition, start: Boxes, *, negated: bool = False) -> Boxes:
    """Return the boxes in which a condition on observations is true.

    Args:
        condition: The condition; its positions are features.
        start: The space to cut them out of.
        negated: Whether its opposite is meant.

    Returns:
        Boxes that may overlap, none of them empty.

    Raises:
        ValueError: If there would be more than 1,000.
    """
    found = _boxes(condition, start, negated)
    return found[~found.is_empty]


def _boxes(condition: Condition, start: Boxes, negated: bool) -> Boxes:
    match condition:
        case Not(part):
            return _boxes(part, start, not negated)
        case Between(position, low, high):
            return _union(start, [_cut(start, position, *ends) for ends in _ends(low, high, negated)])
        case All(parts) | Any(parts):
            if isinstance(condition, All) == negated:
                return _union(start, [boxes_of(part, start, negated=negated) for part in parts])
            for part in parts:
                start = boxes_of(part, start, negated=negated)
            return start


def _ends(low: float, high: float, negated: bool) -> Iterator[tuple[float, float]]:
    if not negated:
        yield low, high
        return
    if low > -np.inf:
        yield -np.inf, float(next_below(low))
    if high < np.inf:
        yield float(next_above(high)), np.inf


def _cut(boxes: Boxes, position: int, low: float, high: float) -> Boxes:
    lows, highs, nan = boxes.low.copy(), boxes.high.copy(), boxes.nan.copy()
    lows[:, position] = np.maximum(lows[:, position], np.float32(low))
    highs[:, position] = np.minimum(highs[:, position], np.float32(high))
    nan[:, position] = False
    return replace(boxes, low=lows, high=highs, nan=nan)


def _union(like: Boxes, parts: Sequence[Boxes]) -> Boxes:
    if sum(map(len, parts)) > _MAX_BOXES:
        raise ValueError(
            f"the condition has more than {_MAX_BOXES:,} cases; split it into several properties"
        )
    return like[:0].joined(parts)


class Propagated(NamedTuple):
    """Parts of boxes, none of them empty, and the leaves in which they end."""

    boxes: Boxes
    leaf: Int[np.ndarray, " parts"]
    origin: Int[np.ndarray, " parts"]
    """The row of the box that each is a part of."""


def propagate(boxes: Boxes, tree: BaseTree) -> Propagated:
    """Split boxes by the leaves of a tree in which their observations end.

    All parts go down together, level by level, and empty ones are dropped at once. So the time is proportional to
    the nodes that are reached, not to the leaves times the boxes.

    Args:
        boxes: Boxes over the tree's features.
        tree: The tree.

    Raises:
        ValueError: If the parts would not fit into memory.
    """
    rows = np.flatnonzero(~boxes.is_empty)
    boxes, origin, node = boxes[rows], rows, np.zeros(len(rows), np.int64)
    done: list[Propagated] = []
    n_done = 0
    while len(boxes):
        at_leaf = tree.is_leaf[node]
        n_done += int(at_leaf.sum())
        check_size(n_done + len(boxes), tree.n_features)
        done.append(Propagated(boxes[at_leaf], node[at_leaf], origin[at_leaf]))
        boxes, origin, node = boxes[~at_leaf], origin[~at_leaf], node[~at_leaf]
        left, right = split_boxes(boxes, tree.feature[node], tree.threshold[node])
        boxes = left.joined([right])
        origin = np.concatenate([origin, origin])
        node = np.concatenate([tree.children_left[node], tree.children_right[node]])
        rows = ~boxes.is_empty
        boxes, origin, node = boxes[rows], origin[rows], node[rows]
    none = np.zeros(0, np.int64)
    return Propagated(
        boxes.joined([part.boxes for part in done]),
        np.concatenate([none, *(part.leaf for part in done)]),
        np.concatenate([none, *(part.origin for part in done)]),
    )


def split_boxes(
    boxes: Boxes, feature: Int[np.ndarray, " boxes"], threshold: Float32[np.ndarray, " boxes"]
) -> tuple[Boxes, Boxes]:
    """Return the parts of boxes to the left and to the right of splits, one split a box.

    Args:
        boxes: The boxes.
        feature: The feature of each split.
        threshold: The threshold of each split.

    Returns:
        As many boxes for each side; some may be empty.
    """
    rows = np.arange(len(boxes))
    high, nan, low = boxes.high.copy(), boxes.nan.copy(), boxes.low.copy()
    high[rows, feature] = np.minimum(high[rows, feature], threshold)
    nan[rows, feature] = False
    low[rows, feature] = np.maximum(low[rows, feature], next_above(threshold))
    return replace(boxes, high=high, nan=nan), replace(boxes, low=low)


def simplest_box(boxes: Boxes) -> int:
    """Return which box holds the observation that is easiest to read.

    It is the box with the fewest numbers other than 0, and of several the one nearest to 0 by the sum of distances
    over its features.
    """
    distance = np.maximum(np.maximum(boxes.low, -boxes.high), 0).astype(np.float64)
    # one feature of each group is 1 in any case
    distance[:, [feature for group in boxes.groups for feature in group.features]] = 0
    return int(np.lexsort((distance.sum(axis=1), np.count_nonzero(distance, axis=1)))[0])


def leaf_actions(tree: BaseTree, leaf: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n components"]:
    """Return the deterministic actions of leaves as claims speak of them: one float64 number a component."""
    return tree.leaf_actions.reshape(tree.n_nodes, -1)[leaf].astype(np.float64)


def predicted_actions(
    tree: BaseTree, observations: Sequence[Float32[np.ndarray, " features"]]
) -> Float[np.ndarray, "n components"]:
    """Return the actions of observations, in the form of `leaf_actions`, from `DecisionTree.predict` itself."""
    return np.reshape(tree.predict(np.stack(observations)), (len(observations), -1)).astype(np.float64)
