"""A tree as a fitted scikit-learn estimator, for the tools that take one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..actions import ActionSpec, BoxActions, DiscreteActions
from ..floats import unflushed_threshold
from ..tree import DecisionTree

if TYPE_CHECKING:
    from jaxtyping import Float
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor


def to_sklearn(tree: DecisionTree) -> DecisionTreeClassifier | DecisionTreeRegressor:
    """Make an estimator whose ``predict`` acts as the tree does, to the bit, on every finite observation.

    Discrete actions make a classifier, several components a classifier with several outputs, continuous
    actions a regressor of the clipped mean, flat in C order. scikit-learn returns one output as [batch],
    without an axis for it, and continuous actions as float64. It refuses infinite observations; those in which
    a group is not one-hot, which the tree refuses, it answers.

    Raises:
        ImportError: if scikit-learn is not installed.
    """
    try:
        from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor
        from sklearn.tree._tree import Tree
    except ImportError as error:
        raise ImportError("to_sklearn needs scikit-learn: pip install 'sympol[sklearn]'") from error

    actions = tree.actions
    value = _leaf_values(tree)
    sizes = _output_sizes(actions)
    visits = np.ones(tree.n_nodes, np.int64) if tree.n_node_samples is None else tree.n_node_samples
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        children = [tree.children_left[node], tree.children_right[node]]
        shares = visits[children] if visits[children].any() else np.ones(2)
        value[node] = np.average(value[children], axis=0, weights=shares)

    grown = Tree(tree.n_features, sizes, len(sizes))
    state: dict[str, Any] = grown.__getstate__()
    nodes: Any = np.zeros(tree.n_nodes, dtype=state["nodes"].dtype)
    nodes["left_child"], nodes["right_child"] = tree.children_left, tree.children_right
    nodes["feature"] = tree.feature
    nodes["threshold"] = [unflushed_threshold(threshold) for threshold in tree.threshold]
    nodes["n_node_samples"] = nodes["weighted_n_node_samples"] = visits
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
    return estimator


def _output_sizes(actions: ActionSpec) -> np.ndarray:
    """Return how many classes each output has, as scikit-learn counts: one where it is a number."""
    if isinstance(actions, BoxActions):
        return np.ones(actions.n_outputs, np.intp)
    return np.array([actions.n] if isinstance(actions, DiscreteActions) else actions.nvec, np.intp)


def _leaf_values(tree: DecisionTree) -> Float[np.ndarray, "nodes outputs classes"]:
    """Return scikit-learn's values: class probabilities padded with zeros, or the numbers themselves."""
    actions = tree.actions
    decided = actions.decide(tree.value)
    if isinstance(actions, BoxActions):
        return decided.reshape(tree.n_nodes, -1, 1).astype(np.float64)
    chances = actions.probabilities(tree.value)
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
