"""Trees of scikit-learn's as ours, without changing a decision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .actions import ActionSpec, BoxActions, DiscreteActions
from .floats import SMALLEST_NORMAL, flushed
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .tree import DecisionTree

if TYPE_CHECKING:
    from jaxtyping import Float, Float32, Float64, Int
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

RAREST = 1e-9
"""The probability, at a leaf, of an action that no sample there has: finite as a logit, and never the largest."""


def from_sklearn(
    estimator: DecisionTreeClassifier | DecisionTreeRegressor, actions: ActionSpec, **space: Any
) -> DecisionTree:
    """Make our tree of a fitted one of scikit-learn's, which acts as it does on every finite observation.

    A classifier's classes are the actions' numbers, one output for each component of `MultiDiscreteActions`; a
    regressor's outputs are the numbers of a continuous action in C order. Leaves hold log-probabilities, or means;
    actions are clipped to their bounds. Observations that are subnormal in float32 count as zero, as everywhere.

    Args:
        estimator: A fitted tree.
        actions: What its answers mean.
        space: What observations are, as in `DecisionTree.from_complete`: feature_names, feature_low, feature_high,
            groups, integers, meta. Names are the estimator's own where it has any, else ``x[0]``, ``x[1]``, ….

    Raises:
        ValueError: it is not fitted, or features, outputs or classes are not those it was fitted on.
        TypeError: it is no tree of scikit-learn's.
    """
    grown = _grown(estimator)
    value = _leaf_values(estimator, actions)
    order = _preorder(grown.children_left, grown.children_right)
    place = np.argsort(order)
    leaf = grown.children_left[order] == NO_CHILD
    left, right = (
        np.where(leaf, NO_CHILD, place[children[order]])
        for children in (grown.children_left, grown.children_right)
    )
    return DecisionTree(
        children_left=left,
        children_right=right,
        feature=np.where(leaf, NO_FEATURE, grown.feature[order]),
        threshold=np.where(leaf, NO_THRESHOLD, rounded_down(grown.threshold[order])),
        value=np.where(leaf[:, None], value[order], 0),
        n_node_samples=grown.n_node_samples[order],
        actions=actions,
        **_space(estimator, grown.n_features, **space),
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
    """What a `DecisionTree` needs to know of observations, as given or by default."""
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
    starts = (actions.start,) if isinstance(actions, DiscreteActions) else actions.start
    parts = zip(classes, starts, sizes, strict=True)
    return np.concatenate([_logits(values[:, k], *part) for k, part in enumerate(parts)], axis=1)


def _sizes(actions: Any) -> tuple[int, ...]:
    return (actions.n,) if isinstance(actions, DiscreteActions) else actions.nvec


def _logits(
    shares: Float64[np.ndarray, "nodes classes"], classes: np.ndarray, start: int, size: int
) -> Float32[np.ndarray, "nodes size"]:
    """Log-probabilities of all actions, also of those that no sample has; the same one is the largest."""
    columns = np.asarray(classes).astype(np.int64) - start
    if (columns != classes - start).any() or (columns < 0).any() or (columns >= size).any():
        raise ValueError(
            f"the classes must be actions, from {start} to {start + size - 1}, got {np.asarray(classes).tolist()}"
        )
    shares = shares[:, : len(columns)]  # padded to the output with the most classes
    totals = shares.sum(axis=1, keepdims=True)
    logits = np.full((len(shares), size), np.log(RAREST), np.float32)
    logits[:, columns] = np.log(np.maximum(shares / totals, RAREST))
    # shares that differ can have logarithms that do not, in float32: let the same action win all the same
    chosen = columns[shares.argmax(axis=1)]
    tied = np.flatnonzero(logits.argmax(axis=1) != chosen)
    logits[tied, chosen[tied]] = np.nextafter(logits[tied].max(axis=1), np.float32(np.inf))
    return logits
