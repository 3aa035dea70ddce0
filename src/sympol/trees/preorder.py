"""The form of a tree's arrays: scikit-learn's marks for leaves, and preorder."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .actions import ActionSpec, DiscreteActions, MultiDiscreteActions
from .floats import brief
from .groups import Group

if TYPE_CHECKING:
    from jaxtyping import Float, Int

    from .tree import DecisionTree

NO_CHILD = -1
NO_FEATURE = -2
NO_THRESHOLD = -2.0
LONGEST_NAME = 10_000
"""Characters of a feature's, an action's, a group's or a category's name."""
MOST_WORDS = 200_000_000
"""Characters of all names together, each as often as a node asks about it or does it."""


def complete_to_preorder(
    feature: Int[np.ndarray, " inner"],
    threshold: Float[np.ndarray, " inner"],
    leaf_values: Float[np.ndarray, "leaves outputs"],
) -> dict[str, np.ndarray]:
    """Return a `DecisionTree`'s arrays for a complete tree in breadth-first order."""
    n_inner = len(feature)
    if (n_inner + 1) & n_inner or threshold.shape != (n_inner,) or leaf_values.shape[:1] != (n_inner + 1,):
        raise ValueError(
            "a complete tree has 2^depth - 1 features and thresholds and 2^depth leaves, got shapes "
            f"{feature.shape}, {threshold.shape} and {leaf_values.shape}"
        )
    breadth_first = complete_order(n_inner)
    preorder = np.argsort(breadth_first)
    inner = breadth_first < n_inner
    complete = breadth_first[inner]

    def at_inner(numbers: np.ndarray, at_leaves: float) -> np.ndarray:
        placed = np.full(len(breadth_first), at_leaves, dtype=numbers.dtype)
        placed[inner] = numbers
        return placed

    value = np.zeros((len(breadth_first), *leaf_values.shape[1:]), dtype=leaf_values.dtype)
    value[~inner] = leaf_values[breadth_first[~inner] - n_inner]
    return {
        "children_left": at_inner(preorder[2 * complete + 1], NO_CHILD),
        "children_right": at_inner(preorder[2 * complete + 2], NO_CHILD),
        "feature": at_inner(feature[complete].astype(np.int64), NO_FEATURE),
        "threshold": at_inner(threshold[complete].astype(np.float64), NO_THRESHOLD),
        "value": value,
    }


def complete_order(n_inner: int) -> Int[np.ndarray, " nodes"]:
    """The nodes of a complete tree, counted breadth-first, in preorder."""
    order, awaited = [], [0]
    while awaited:
        order.append(node := awaited.pop())
        if node < n_inner:
            awaited += [2 * node + 2, 2 * node + 1]
    return np.array(order)


def check(tree: DecisionTree) -> None:
    """Raise ValueError unless the arrays are one tree in preorder over the features and actions it names."""
    n_nodes, n_features, n_outputs = tree.n_nodes, tree.n_features, tree.actions.n_outputs
    shapes = {"children_left": n_nodes, "children_right": n_nodes, "feature": n_nodes, "threshold": n_nodes}
    shapes |= {"feature_low": n_features, "feature_high": n_features}
    shapes |= {} if tree.n_node_samples is None else {"n_node_samples": n_nodes}
    for name, length in shapes.items():
        if getattr(tree, name).shape != (length,):
            raise ValueError(f"{name} must have shape ({length},), got {getattr(tree, name).shape}")
    if n_nodes == 0 or tree.value.shape != (n_nodes, n_outputs):
        raise ValueError(f"value must have shape ({max(n_nodes, 1)}, {n_outputs}), got {tree.value.shape}")
    if not all(isinstance(name, str) for name in tree.feature_names):
        raise ValueError(f"feature_names must be strings, got {tree.feature_names!r}")
    for name in ("threshold", "value"):
        if not np.isfinite(array := getattr(tree, name)).all():
            raise ValueError(f"{name} must be finite in float32, got {array[~np.isfinite(array)][0]}")
    if not (tree.feature_low <= tree.feature_high).all():
        worst = int(np.argmin(tree.feature_low <= tree.feature_high))
        raise ValueError(
            f"feature_low must not exceed feature_high, got {tree.feature_low[worst]} and "
            f"{tree.feature_high[worst]} for {tree.feature_names[worst]!r}; use -inf and inf for no bound"
        )
    _check_preorder(tree)
    _check_lengths(tree)
    leaf = tree.is_leaf
    if (tree.feature[leaf] != NO_FEATURE).any() or (tree.threshold[leaf] != NO_THRESHOLD).any():
        raise ValueError(f"leaves must have feature {NO_FEATURE} and threshold {NO_THRESHOLD}")
    if tree.value[~leaf].any():
        raise ValueError("value must be zero at inner nodes: only leaves answer")
    looked_at = tree.feature[~leaf]
    if ((looked_at < 0) | (looked_at >= n_features)).any():
        raise ValueError(
            f"feature must be in [0, {n_features}) at inner nodes, got {sorted(set(looked_at.tolist()))}"
        )
    if (visits := tree.n_node_samples) is not None:
        below = visits[tree.children_left[~leaf]] + visits[tree.children_right[~leaf]]
        if (visits < 0).any() or (visits[~leaf] != below).any():
            raise ValueError("n_node_samples must not be negative, and an inner node's is its children's sum")


def _check_lengths(tree: DecisionTree) -> None:
    """Raise ValueError where names are so long that they would fill the memory when every node is written."""
    names = _lengths(tree.feature_names, tree.groups, tree.actions)
    if len(names.longest) > LONGEST_NAME:
        raise ValueError(
            f"a name has at most {LONGEST_NAME:,} characters, got one of {len(names.longest):,}: {brief(names.longest)}"
        )
    looked_at = tree.feature[~tree.is_leaf]
    known = looked_at[(looked_at >= 0) & (looked_at < tree.n_features)]
    if (written := int(names.asked[known].sum()) + tree.n_leaves * names.answer) > MOST_WORDS:
        raise ValueError(
            f"the names of features and actions would be written {written:,} characters long in a tree of "
            f"{tree.n_nodes:,} nodes, more than {MOST_WORDS:,}: give shorter names"
        )


class _Lengths(NamedTuple):
    """How long names are."""

    longest: str
    asked: Int[np.ndarray, " features"]
    """What a question about each feature names."""
    answer: int
    """What an answer names, at most."""


@lru_cache(maxsize=16)
def _lengths(features: tuple[str, ...], groups: tuple[Group, ...], actions: ActionSpec) -> _Lengths:
    """Measure; many trees, one after the other, are of the same features and actions."""
    asked = np.array([len(name) for name in features], np.int64)
    for group in groups:
        asked[list(group.features)] = [len(group.name) + len(category) for category in group.categories]
    options = actions.options if isinstance(actions, MultiDiscreteActions) else ()
    if isinstance(actions, DiscreteActions):
        answer = max(map(len, actions.names))
    else:
        answer = sum(map(len, actions.names)) + sum(max(map(len, names)) for names in options)
    in_groups = [name for group in groups for name in (group.name, *group.categories)]
    every = (*features, *in_groups, *actions.names, *(name for names in options for name in names))
    return _Lengths(max(every, key=len, default=""), asked, answer)


def _check_preorder(tree: DecisionTree) -> None:
    """Raise ValueError unless each node but the root is the child of one before it, left subtree first."""
    right_children: list[int] = []
    links = zip(tree.children_left.tolist(), tree.children_right.tolist(), strict=True)
    for node, (left, right) in enumerate(links):
        follows = left
        if left == right == NO_CHILD:
            follows = right_children.pop() if right_children else tree.n_nodes
        else:
            right_children.append(right)
        if follows != node + 1:
            raise ValueError(
                f"nodes must be in preorder, left subtree first: after node {node} comes {follows}"
            )
    if right_children:
        raise ValueError(
            f"nodes must be in preorder, left subtree first: node {right_children[-1]} is missing"
        )
