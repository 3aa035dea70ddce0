"""Exact checks of a tree: properties, monotonicity among them, and equality of two trees.

Each sends boxes of observations down the tree and looks at the leaves in which they end. An observation that is
returned as a counterexample has been tried on the tree itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..actions import BoxActions, DiscreteActions, MultiDiscreteActions
from ..base import BaseTree
from ..boxes import Boxes, space
from ..floats import printable, simplest_float
from .conditions import (
    Condition,
    Propagated,
    boxes_of,
    leaf_actions,
    predicted_actions,
    propagate,
    satisfied,
    simplest_box,
)
from .grammar import Monotone, Rule, parse_rule
from .properties import (
    Example,
    Property,
    PropertyLike,
    Verdict,
    action_words,
    as_properties,
    example_of,
    observation_words,
)

if TYPE_CHECKING:
    from jaxtyping import Float32, Int

    Observation = Float32[np.ndarray, " features"]

_PAIRS_AT_ONCE = 50_000
"""Pairs of boxes that are compared at the same time."""


# ---- properties ----


def verify(tree: BaseTree, properties: Iterable[PropertyLike]) -> tuple[Verdict, ...]:
    """Prove properties of a tree, or find an observation that refutes each.

    Args:
        tree: The policy.
        properties: Rules, `Property` objects, and paths of files of properties.

    Returns:
        One verdict for each property, in their order.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If a rule cannot be parsed, or names something that the tree lacks.
    """
    rules = [(one, _parsed(one, tree)) for one in as_properties(properties)]
    return tuple(_prove(tree, one, rule) for one, rule in rules)


def _parsed(one: Property, tree: BaseTree) -> Rule:
    try:
        return parse_rule(one.rule, tree)
    except ValueError as error:
        prefix = "" if one.name == one.rule else f"property {one.name!r}: "
        raise ValueError(f"{prefix}{error}") from None


def _prove(tree: BaseTree, one: Property, rule: Rule) -> Verdict:
    start = space(tree, bounds=one.within_bounds)
    meant = boxes_of(rule.condition, start)
    if not len(meant):
        return Verdict(one.name, one.rule, holds=True, vacuous=True)
    parts = propagate(meant, tree)
    if isinstance(rule.claim, Monotone):
        leaves, found = _violating_pair(tree, rule.claim, parts)
        confirmed = not found or _is_violating_pair(tree, rule.claim, found)
    else:
        leaves, found = _violating_observation(tree, rule.claim, parts)
        confirmed = not found or not satisfied(rule.claim, predicted_actions(tree, found)).any()
    for x in found:
        confirmed &= bool(satisfied(rule.condition, x[None])[0] and start.contains(x[None])[0, 0])
    if not confirmed:
        raise RuntimeError(
            f"sympol was about to give a wrong counterexample to {one.rule!r}; please report it"
        )
    return Verdict(
        one.name,
        one.rule,
        holds=not found,
        n_leaves=len(np.unique(parts.leaf)),
        n_violating=len(leaves),
        examples=tuple(example_of(tree, x) for x in found),
    )


def _violating_observation(
    tree: BaseTree, claim: Condition, parts: Propagated
) -> tuple[Int[np.ndarray, " leaves"], list[Observation]]:
    """Return the leaves that violate a claim, and the simplest observation that ends in one, if there is any."""
    wrong = satisfied(claim, leaf_actions(tree, parts.leaf), negated=True)
    if not wrong.any():
        return parts.leaf[wrong], []
    boxes = parts.boxes[wrong]
    return np.unique(parts.leaf[wrong]), [boxes.some_observation(simplest_box(boxes))]


# ---- monotonicity ----


def _violating_pair(
    tree: BaseTree, claim: Monotone, parts: Propagated
) -> tuple[Int[np.ndarray, " leaves"], list[Observation]]:
    """Return the leaves between which a monotonicity fails, and two observations that show it, if there are any.

    The second of the two has the greater feature, and equals the first in all others.
    """
    leaves, pair = _violating_boxes(tree, claim, parts)
    if pair is None:
        return leaves, []
    i, j = pair
    boxes, feature = parts.boxes, claim.feature
    x = _common(boxes, feature, np.array([i]), np.array([j])).some_observation()
    low, high = boxes.low[:, feature], boxes.high[:, feature]
    x[feature] = simplest_float(float(low[i]), float(min(high[i], high[j])))
    y = x.copy()
    y[feature] = simplest_float(float(max(low[j], x[feature])), float(high[j]))
    return leaves, [x, y]


def _is_violating_pair(tree: BaseTree, claim: Monotone, pair: list[Observation]) -> bool:
    x, y = pair
    same = np.array_equal(np.delete(x, claim.feature), np.delete(y, claim.feature), equal_nan=True)
    before, after = _sign(claim) * predicted_actions(tree, pair)[:, claim.component]
    return same and bool(x[claim.feature] < y[claim.feature] and before > after)


def _sign(claim: Monotone) -> int:
    return 1 if claim.increasing else -1


class _ViolatingBoxes(NamedTuple):
    leaves: Int[np.ndarray, " leaves"]
    simplest: tuple[int, int] | None
    """Rows of the pair of boxes whose common observations are easiest to read."""


def _violating_boxes(tree: BaseTree, claim: Monotone, parts: Propagated) -> _ViolatingBoxes:
    """Find pairs of boxes such that an observation moves from one to the other by the feature alone."""
    action = _sign(claim) * leaf_actions(tree, parts.leaf)[:, claim.component]
    low, high = parts.boxes.low[:, claim.feature], parts.boxes.high[:, claim.feature]
    involved = np.zeros(len(action), bool)
    best: list[tuple[int, int]] = []
    for rows in np.array_split(np.arange(len(action)), len(action) ** 2 // _PAIRS_AT_ONCE + 1):
        first, second = np.nonzero((action[rows, None] > action) & (low[rows, None] <= high))
        first = rows[first]
        common = _common(parts.boxes, claim.feature, first, second)
        possible = ~common.is_empty
        if possible.any():
            involved[first[possible]] = involved[second[possible]] = True
            pick = np.flatnonzero(possible)[simplest_box(common[possible])]
            best.append((int(first[pick]), int(second[pick])))
    if not best:
        return _ViolatingBoxes(np.zeros(0, np.int64), None)
    of_best = _common(parts.boxes, claim.feature, *np.array(best).T)
    return _ViolatingBoxes(np.unique(parts.leaf[involved]), best[simplest_box(of_best)])


def _common(boxes: Boxes, feature: int, first: np.ndarray, second: np.ndarray) -> Boxes:
    """Return the intersections of pairs of boxes, with the feature left free."""
    one, two = boxes[first], boxes[second]
    low, high, nan = np.maximum(one.low, two.low), np.minimum(one.high, two.high), one.nan & two.nan
    low[:, feature], high[:, feature], nan[:, feature] = -np.inf, np.inf, False
    return replace(boxes, low=low, high=high, nan=nan)


# ---- equality ----


def equal(tree: BaseTree, other: BaseTree, *, within_bounds: bool = True) -> Verdict:
    """Prove that two trees act the same on every observation, or find one on which they differ.

    Observations are those that both accept: within the bounds of both, with the groups and whole numbers of either.
    No other counterexample has fewer numbers that are not 0.

    Args:
        tree: A policy.
        other: A policy with the same features and actions.
        within_bounds: Whether only observations within the bounds of the spaces count.

    Returns:
        Whether they are equal, with a counterexample if they are not.

    Raises:
        ValueError: If the trees have different features, groups or actions.
    """
    _require_same_kind(tree, other)
    parts = propagate(_common_space(tree, other, within_bounds), tree)
    of_other = propagate(parts.boxes, other)
    leaf = parts.leaf[of_other.origin]
    differs = (leaf_actions(tree, leaf) != leaf_actions(other, of_other.leaf)).any(axis=1)
    name, rule = "equal", "both trees act the same"
    n_leaves, n_violating = len(np.unique(leaf)), len(np.unique(leaf[differs]))
    if not differs.any():
        return Verdict(name, rule, holds=True, vacuous=n_leaves == 0, n_leaves=n_leaves)
    boxes = of_other.boxes[differs]
    x = boxes.some_observation(simplest_box(boxes))
    if (predicted_actions(tree, [x]) == predicted_actions(other, [x])).all():
        raise RuntimeError(
            f"sympol was about to say wrongly that two trees differ at {x.tolist()}; please report it"
        )
    action = f"{action_words(tree, x)}; the other: {action_words(other, x)}"
    return Verdict(
        name,
        rule,
        holds=False,
        n_leaves=n_leaves,
        n_violating=n_violating,
        examples=(Example(x, observation_words(tree, x), action),),
    )


def _require_same_kind(tree: BaseTree, other: BaseTree) -> None:
    if tree.feature_names != other.feature_names:
        pairs = zip(tree.feature_names, other.feature_names, strict=False)
        different = [f"{printable(a)!r} and {printable(b)!r}" for a, b in pairs if a != b]
        what = different[0] if different else f"{tree.n_features} and {other.n_features} of them"
        raise ValueError(
            f"the trees see other features: {what}; only trees of one environment can be compared"
        )
    if tree.groups and other.groups and tree.groups != other.groups:
        raise ValueError(
            "the trees see other groups of features; only trees of one environment can be compared"
        )
    if _kind(tree) != _kind(other):
        kinds = (" ".join(map(str, _kind(one))) for one in (tree, other))
        raise ValueError(
            f"the trees have other actions: {' and '.join(kinds)}; only trees of one environment can be compared"
        )


def _kind(tree: BaseTree) -> tuple[object, ...]:
    match tree.actions:
        case BoxActions(shape=shape):
            return ("numbers in the shape", *shape)
        case DiscreteActions(n=n, start=start):
            return (n, "actions from number", start)
        case MultiDiscreteActions(nvec=nvec, start=start):
            return (nvec, "options from number", start)


def _common_space(tree: BaseTree, other: BaseTree, within_bounds: bool) -> Boxes:
    one, two = space(tree, bounds=within_bounds), space(other, bounds=within_bounds)
    grouped = {feature for group in (*tree.groups, *other.groups) for feature in group.features}
    integers = tuple(sorted({*tree.integers, *other.integers} - grouped))
    return replace(one, groups=tree.groups or other.groups, integers=integers).intersect(two)
