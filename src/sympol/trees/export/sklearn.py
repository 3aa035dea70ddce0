"""A tree as a fitted scikit-learn estimator, for the tools that take one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..actions import ActionSpec, BoxActions, DiscreteActions
from ..base import BaseTree
from ..floats import unflushed_threshold
from ..preorder import visits

if TYPE_CHECKING:
    from jaxtyping import Float
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor


def to_sklearn(tree: BaseTree, *, names: bool = True) -> DecisionTreeClassifier | DecisionTreeRegressor:
    """Make an estimator whose ``predict`` acts as the tree does, to the bit, on every finite observation.

    Discrete actions make a classifier, several components a classifier with several outputs, continuous
    actions a regressor of the clipped mean, flat in C order. scikit-learn returns one output as [batch],
    without an axis for it, and continuous actions as float64. It refuses infinite observations; those in which
    a group is not one-hot, which the tree refuses, it answers.

    Its samples are the tree's visits; where these are unknown or none, each leaf counts as one. Impurities follow from
    the probabilities at the leaves (Gini), or from their numbers (variance), and the features' importances from both.

    Args:
        tree: What is written.
        names: Whether the estimator has the features' names, where they have any but ``x[0]``, ``x[1]``, …. If so,
            scikit-learn warns when it is given observations without names, as arrays are.

    Returns:
        A fitted classifier or regressor.
    """
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor
    from sklearn.tree._tree import Tree

    actions = tree.actions
    value = _leaf_values(tree)
    sizes = _output_sizes(actions)
    samples = tree.n_node_samples
    if samples is None or not samples[0]:
        samples = visits(tree.children_left, tree.children_right, np.flatnonzero(tree.is_leaf))
    is_class = not isinstance(actions, BoxActions)
    impurity = _gini(value) if is_class else np.zeros(tree.n_nodes)
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        children = [tree.children_left[node], tree.children_right[node]]
        shares = samples[children] if samples[children].any() else np.ones(2)
        value[node] = np.average(value[children], axis=0, weights=shares)
        away = 0 if is_class else ((value[children] - value[node]) ** 2).mean(axis=(1, 2))
        impurity[node] = (
            _gini(value[[node]])[0] if is_class else np.average(impurity[children] + away, weights=shares)
        )

    grown = Tree(tree.n_features, sizes, len(sizes))
    state: dict[str, Any] = grown.__getstate__()
    nodes: Any = np.zeros(tree.n_nodes, dtype=state["nodes"].dtype)
    nodes["left_child"], nodes["right_child"] = tree.children_left, tree.children_right
    nodes["feature"] = tree.feature
    nodes["threshold"] = [unflushed_threshold(threshold) for threshold in tree.threshold]
    nodes["n_node_samples"] = nodes["weighted_n_node_samples"] = samples
    nodes["impurity"] = impurity
    grown.__setstate__(
        {**state, "max_depth": tree.depth, "node_count": tree.n_nodes, "nodes": nodes, "values": value}
    )

    if isinstance(actions, BoxActions):
        estimator = DecisionTreeRegressor()
    else:
        estimator = DecisionTreeClassifier()
        starts = (actions.start,) if isinstance(actions, DiscreteActions) else actions.start
        classes = [np.arange(start, start + size) for start, size in zip(starts, sizes, strict=True)]
        # scikit-learn drops the list where there is one output only
        estimator.classes_ = classes if len(sizes) > 1 else classes[0]
        estimator.n_classes_ = sizes if len(sizes) > 1 else sizes[0]
    estimator.tree_ = grown
    estimator.n_outputs_ = len(sizes)
    estimator.n_features_in_ = estimator.max_features_ = tree.n_features
    if names and tree.feature_names != tuple(f"x[{i}]" for i in range(tree.n_features)):
        setattr(estimator, "feature_names_in_", np.array(tree.feature_names, dtype=object))  # noqa: B010
    return estimator


def _gini(value: Float[np.ndarray, "nodes outputs classes"]) -> Float[np.ndarray, " nodes"]:
    """The impurity of shares, the mean of all outputs, as scikit-learn has it; 0 where there are none."""
    total = value.sum(axis=2, keepdims=True)
    shares = value / np.where(total == 0, 1, total)
    return np.where(total[..., 0] == 0, 0, 1 - (shares**2).sum(axis=2)).mean(axis=1)


def _output_sizes(actions: ActionSpec) -> np.ndarray:
    """Return how many classes each output has, as scikit-learn counts: one where it is a number."""
    if isinstance(actions, BoxActions):
        return np.ones(actions.n_outputs, np.intp)
    return np.array([actions.n] if isinstance(actions, DiscreteActions) else actions.nvec, np.intp)


def _leaf_values(tree: BaseTree) -> Float[np.ndarray, "nodes outputs classes"]:
    """Return scikit-learn's values: class probabilities padded with zeros, or the numbers themselves."""
    actions = tree.actions
    decided = tree.leaf_actions
    if isinstance(actions, BoxActions):
        return decided.reshape(tree.n_nodes, -1, 1).astype(np.float64)
    chances = actions.probabilities(tree.leaf_outputs)
    parts = chances if isinstance(chances, tuple) else (chances,)
    value = np.zeros((tree.n_nodes, len(parts), max(part.shape[1] for part in parts)))
    start = np.reshape(actions.start, (1, -1))
    chosen = decided.reshape(tree.n_nodes, -1) - start
    for output, part in enumerate(parts):
        value[:, output, : part.shape[1]] = part
        # logits that differ can have probabilities that do not: let the action win all the same
        tied = np.flatnonzero(part.argmax(axis=1) != chosen[:, output])
        value[tied, output, chosen[tied, output]] = np.nextafter(part[tied].max(axis=1), 2.0)
    return value
