"""Conversion of scikit-learn's trees, without changing a decision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .actions import ActionSpec, BoxActions, DiscreteActions
from .base import TreeT
from .floats import SMALLEST_NORMAL, brief, flushed
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD

if TYPE_CHECKING:
    from jaxtyping import Float, Float32, Float64, Int
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

RAREST = 1e-9
"""The probability, at a leaf, of an action that no sample there has: finite as a logit, and never the largest."""


def from_sklearn(
    estimator: DecisionTreeClassifier | DecisionTreeRegressor,
    actions: ActionSpec,
    kind: type[TreeT],
    **space: Any,
) -> TreeT:
    """Convert a fitted tree of scikit-learn to one that acts the same on every finite observation.

    A classifier's classes are the actions' numbers or names, one output for each component of
    `MultiDiscreteActions`; a regressor's outputs are the numbers of a continuous action in C order. Leaves hold
    log-probabilities, or means; actions are clipped to their bounds. Observations that are subnormal in float32 count
    as zero, as everywhere.

    NaN goes right at every split, as in all trees here. An estimator that learned from missing values and sends them
    left somewhere is refused. One thing cannot be told: where all of its splits send them to the side with more
    samples, it looks as it would if there had been none, and is taken for that.

    Args:
        estimator: A fitted tree.
        actions: The meaning of its predictions.
        kind: The class of the returned tree.
        space: What observations are, as in `DecisionTree.from_complete`: feature_names, feature_low, feature_high,
            groups, integers, meta. Names are the estimator's own where it has any, else ``x[0]``, ``x[1]``, ….

    Raises:
        ValueError: it is not fitted; features, outputs or classes are not those it was fitted on; it sends missing
            values left; or a threshold is infinite and no split between missing values and numbers.
        TypeError: it is no tree of scikit-learn's.
    """
    grown = _grown(estimator)
    space = _space(estimator, grown.n_features, **space)
    threshold = _thresholds(grown, space["feature_names"])
    value = _leaf_values(estimator, actions)
    order = _preorder(grown.children_left, grown.children_right)
    place = np.argsort(order)
    leaf = grown.children_left[order] == NO_CHILD
    left, right = (
        np.where(leaf, NO_CHILD, place[children[order]])
        for children in (grown.children_left, grown.children_right)
    )
    return kind(
        children_left=left,
        children_right=right,
        feature=np.where(leaf, NO_FEATURE, grown.feature[order]),
        threshold=np.where(leaf, NO_THRESHOLD, threshold[order]),
        value=np.where(leaf[:, None], value[order], 0),
        n_node_samples=grown.n_node_samples[order],
        actions=actions,
        **space,
    )


def _grown(estimator: Any) -> Any:
    """The estimator's own arrays."""
    if not hasattr(estimator, "get_params") or not hasattr(estimator, "max_leaf_nodes"):
        raise TypeError(
            f"expected a DecisionTreeClassifier or DecisionTreeRegressor, got a {type(estimator).__name__}"
        )
    if not hasattr(estimator, "tree_"):
        raise ValueError(
            f"the {type(estimator).__name__} is no single fitted tree; fit it first: estimator.fit(X, y)"
        )
    return estimator.tree_


def _space(estimator: Any, n_features: int, **given: Any) -> dict[str, Any]:
    """What a tree needs to know of observations, as given or by default."""
    if given.get("feature_names") is None:
        own = getattr(estimator, "feature_names_in_", [f"x[{i}]" for i in range(n_features)])
        given["feature_names"] = tuple(map(str, own))
    if len(given["feature_names"]) != n_features:
        raise ValueError(
            f"{len(given['feature_names'])} features were named, but the estimator was fitted on {n_features}"
        )
    for bound, none in (("feature_low", -np.inf), ("feature_high", np.inf)):
        if given.get(bound) is None:
            given[bound] = np.full(n_features, none)
    return given


def _thresholds(grown: Any, names: Sequence[str]) -> Float32[np.ndarray, " nodes"]:
    """The thresholds in float32, if they decide as the estimator does, also on missing values.

    A split of missing values from numbers has an infinite threshold: no number is beyond the largest one.
    """
    left, right, feature, threshold = (
        getattr(grown, name) for name in ("children_left", "children_right", "feature", "threshold")
    )
    inner, samples = left != NO_CHILD, grown.n_node_samples
    goes_left = inner & np.asarray(getattr(grown, "missing_go_to_left", np.zeros(len(left)))).astype(bool)
    apart = np.isposinf(threshold)
    # of a split that was learned without missing values, scikit-learn says that they go where more samples went
    learned = inner & (apart | (goes_left != (samples[left] > samples[right])))
    wrong = np.flatnonzero(goes_left)
    if learned.any() and wrong.size:
        raise ValueError(
            f"node {wrong[0]} of the estimator sends missing values of {brief(names[feature[wrong[0]]])} left, where "
            "every tree here sends NaN right: fill missing values in, and fit it without them"
        )
    rounded = np.where(apart, np.finfo(np.float32).max, rounded_down(np.where(apart, 0, threshold)))
    if (infinite := np.flatnonzero(inner & ~np.isfinite(rounded))).size:
        raise ValueError(
            f"node {infinite[0]} of the estimator has the threshold {threshold[infinite[0]]}, which is none in float32"
        )
    return rounded


def rounded_down(threshold: Float64[np.ndarray, " nodes"]) -> Float32[np.ndarray, " nodes"]:
    """Return the largest float32 numbers, subnormal ones left out, that are no larger than these.

    For every float32 x that is not subnormal ``x <= rounded_down(t)`` says what ``x <= t`` says. Rounding to nearest
    would take some x over the threshold, and flushing a negative subnormal t to zero would do so to x = 0.
    """
    with np.errstate(over="ignore"):
        nearest = np.asarray(threshold, np.float64).astype(np.float32)
    down = np.where(nearest > threshold, np.nextafter(nearest, np.float32(-np.inf)), nearest)
    just_below = (down < 0) & (down > -SMALLEST_NORMAL)
    return flushed(np.where(just_below, np.float32(-SMALLEST_NORMAL), down))


def _preorder(left: Int[np.ndarray, " nodes"], right: Int[np.ndarray, " nodes"]) -> Int[np.ndarray, " nodes"]:
    """The nodes, left subtree first; scikit-learn's are in another order where ``max_leaf_nodes`` was set."""
    order, awaited = [], [0]
    while awaited:
        order.append(node := awaited.pop())
        if left[node] != NO_CHILD:
            awaited += [int(right[node]), int(left[node])]
    return np.array(order)


def _leaf_values(estimator: Any, actions: ActionSpec) -> Float[np.ndarray, "nodes outputs"]:
    """What our leaves hold, for each of scikit-learn's nodes, whose values are [nodes, outputs, classes]."""
    values = estimator.tree_.value
    sizes = () if isinstance(actions, BoxActions) else _sizes(actions)
    n_outputs = len(sizes) or actions.n_outputs
    if values.shape[1] != n_outputs or hasattr(estimator, "classes_") != bool(sizes):
        raise ValueError(
            f"for {actions} scikit-learn's tree must be a {'classifier' if sizes else 'regressor'} with {n_outputs} "
            f"output{'s' if n_outputs > 1 else ''}, got a {type(estimator).__name__} with {values.shape[1]}"
        )
    if isinstance(actions, BoxActions):
        return values[:, :, 0].astype(np.float32)
    several = isinstance(estimator.classes_, list)  # one output's are not in a list
    classes = estimator.classes_ if several else [estimator.classes_]
    discrete = isinstance(actions, DiscreteActions)
    starts, names = ((actions.start,), (actions.names,)) if discrete else (actions.start, actions.options)
    parts = zip(classes, starts, names, strict=True)
    return np.concatenate([_logits(values[:, k], *part) for k, part in enumerate(parts)], axis=1)


def _sizes(actions: Any) -> tuple[int, ...]:
    return (actions.n,) if isinstance(actions, DiscreteActions) else actions.nvec


def _logits(
    shares: Float64[np.ndarray, "nodes classes"], classes: np.ndarray, start: int, names: tuple[str, ...]
) -> Float32[np.ndarray, "nodes size"]:
    """Log-probabilities of all actions, also of those that no sample has; the same one is the largest."""
    size, columns = len(names), _columns(np.asarray(classes).tolist(), start, names)
    shares = shares[:, : len(columns)]  # padded to the output with the most classes
    totals = shares.sum(axis=1, keepdims=True)
    logits = np.full((len(shares), size), np.log(RAREST), np.float32)
    logits[:, columns] = np.log(np.maximum(shares / totals, RAREST))
    # shares that differ can have logarithms that do not, in float32: let the same action win all the same
    chosen = columns[shares.argmax(axis=1)]
    tied = np.flatnonzero(logits.argmax(axis=1) != chosen)
    logits[tied, chosen[tied]] = np.nextafter(logits[tied].max(axis=1), np.float32(np.inf))
    return logits


def _columns(classes: list[Any], start: int, names: tuple[str, ...]) -> Int[np.ndarray, " classes"]:
    """Which action each class is, by its number or by its name. Raises ValueError where one is none."""
    columns = []
    for one in classes:
        if isinstance(one, str):
            found = [i for i, name in enumerate(names) if name == one]
        else:
            found = [i for i in range(len(names)) if one == start + i]
        columns += found if len(found) == 1 else [-1]
    if -1 in columns:
        named = f"; by name there are {', '.join(map(repr, names))}" if isinstance(classes[0], str) else ""
        raise ValueError(
            f"the classes must be actions, from {start} to {start + len(names) - 1}, got {classes}{named}"
        )
    return np.array(columns)
