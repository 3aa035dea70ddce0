"""CART by scikit-learn, and from its fitted trees to ours without changing a decision."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from ..trees.actions import ActionSpec, BoxActions, DiscreteActions
from ..trees.floats import SMALLEST_NORMAL, flushed
from ..trees.preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD

if TYPE_CHECKING:
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

RAREST = 1e-9
"""The probability, at a leaf, of an action that no sample there has: finite as a logit, and never the largest."""


def fit_cart(
    x: Float32[np.ndarray, "samples features"], actions: np.ndarray, spec: EnvSpec, *, depth: int, seed: int
) -> DecisionTree:
    """Grow a tree by CART (Breiman et al. 1984) on observations and the actions to take in them.

    Discrete actions are classified by Gini impurity, several components at once; continuous ones are regressed by
    squared error. Which of equally good splits is taken depends on ``seed``, and on nothing else.

    Raises:
        ImportError: scikit-learn is not installed.
        ValueError: an observation that is not finite: CART cannot sort it.
    """
    try:
        from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor
    except ImportError as error:
        raise ImportError(
            "distilling a tree needs scikit-learn, which is not installed; install it: pip install 'sympol[bench]'"
        ) from error
    finite = np.isfinite(x).all(axis=1)
    if not finite.all():
        raise ValueError(
            f"{spec.name} returned the observation {x[np.argmin(finite)].tolist()}, which is not finite; CART cannot "
            "sort it: correct the environment"
        )
    kind = DecisionTreeRegressor if isinstance(spec.actions, BoxActions) else DecisionTreeClassifier
    targets = actions if actions.ndim == 1 else actions.reshape(len(actions), -1)
    estimator = kind(max_depth=depth, random_state=seed).fit(x, targets)
    return _within_seen_bounds(from_sklearn(estimator, spec), spec, x)


def from_sklearn(estimator: DecisionTreeClassifier | DecisionTreeRegressor, spec: EnvSpec) -> DecisionTree:
    """Make our tree of a fitted one of scikit-learn's, which acts as it does on every finite observation.

    A classifier's classes are the environment's actions, one output for each component of ``MultiDiscrete``; a
    regressor's outputs are the numbers of a continuous action in C order. Leaves hold log-probabilities, or means;
    actions are clipped to their bounds. Observations that are subnormal in float32 count as zero, as everywhere.

    Raises:
        ValueError: features, outputs or classes that are not the environment's.
    """
    grown = estimator.tree_
    n_features = len(spec.features.names)
    if grown.n_features != n_features:
        raise ValueError(
            f"a tree for {spec.name} must see {n_features} features, got one fitted on {grown.n_features}"
        )
    value = _leaf_values(estimator, spec.actions)
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
        actions=spec.actions,
        feature_names=spec.features.names,
        feature_low=spec.features.low,
        feature_high=spec.features.high,
        groups=spec.features.groups,
        integers=spec.features.integers,
        n_node_samples=grown.n_node_samples[order],
    )


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


def _within_seen_bounds(tree: DecisionTree, spec: EnvSpec, x: np.ndarray) -> DecisionTree:
    """The same tree without the bounds that the environment itself broke: pruning would believe them."""

    low, high = spec.features.low, spec.features.high
    return replace(
        tree,
        feature_low=np.where(x.min(axis=0) < low, -np.inf, low),
        feature_high=np.where(x.max(axis=0) > high, np.inf, high),
    )
