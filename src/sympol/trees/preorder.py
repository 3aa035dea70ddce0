"""A tree as arrays in preorder: the marks of leaves, complete trees, and how observations descend.

``left``, ``right``, ``feature`` and ``threshold`` are the arrays of a `BaseTree`, or changed copies of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32, Int, Int32

    Links = Int[np.ndarray, " nodes"]

NO_CHILD = -1
NO_FEATURE = -2
NO_THRESHOLD = -2.0


def complete_to_preorder(
    feature: Int[np.ndarray, " inner"],
    threshold: Float[np.ndarray, " inner"],
    leaf_values: Float[np.ndarray, "leaves outputs"],
) -> dict[str, np.ndarray]:
    """Return the node arrays of a complete tree that is given in breadth-first order.

    Args:
        feature: The feature each inner node compares, [inner], with inner = 2^depth − 1.
        threshold: What it is compared with, [inner].
        leaf_values: The outputs of each leaf, [inner + 1, outputs].

    Returns:
        The arrays that `BaseTree` takes, by name.

    Raises:
        ValueError: If the shapes are not those of a complete tree.
    """
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
    """Return the nodes of a complete tree in preorder, numbered breadth-first."""
    order, awaited = [], [0]
    while awaited:
        order.append(node := awaited.pop())
        if node < n_inner:
            awaited += [2 * node + 2, 2 * node + 1]
    return np.array(order)


def descend(
    left: Links,
    right: Links,
    feature: Int32[np.ndarray, " nodes"],
    threshold: Float32[np.ndarray, " nodes"],
    x: Float32[np.ndarray, "batch features"],
    root: int = 0,
) -> Int32[np.ndarray, " batch"]:
    """Return the leaf each observation [batch, features] reaches from the node ``root``."""
    node = np.full(len(x), root, np.int32)
    rows = np.arange(0 if left[root] == NO_CHILD else len(x))
    while rows.size:
        at = node[rows]
        goes_left = x[rows, feature[at]] <= threshold[at]
        node[rows] = np.where(goes_left, left[at], right[at])
        rows = rows[left[node[rows]] != NO_CHILD]
    return node


def descend_one(
    left: list[int], right: list[int], feature: list[int], threshold: list[float], x: list[float]
) -> int:
    """Return the leaf one observation reaches from the root.

    Plain lists: for a single row, one NumPy operation takes longer than the whole descent in Python.
    """
    node = 0
    while left[node] != NO_CHILD:
        node = left[node] if x[feature[node]] <= threshold[node] else right[node]
    return node


def depths(left: Links, right: Links) -> Links:
    """Return the number of comparisons above each node."""
    depth = np.zeros(len(left), np.int64)
    for node in np.flatnonzero(left != NO_CHILD):
        depth[[left[node], right[node]]] = depth[node] + 1
    return depth


def paths(left: Links, right: Links, leaf: Int[np.ndarray, " batch"]) -> Bool[np.ndarray, "batch nodes"]:
    """Return which nodes lie on the path to each of these leaves."""
    on_path = np.zeros((leaf.size, len(left)), dtype=bool)
    on_path[np.arange(leaf.size), leaf] = True
    for node in np.flatnonzero(left != NO_CHILD)[::-1]:
        on_path[:, node] = on_path[:, left[node]] | on_path[:, right[node]]
    return on_path


def visits(left: Links, right: Links, leaf: Int[np.ndarray, " batch"]) -> Links:
    """Count for each node how many of these leaves lie at or below it."""
    counts = np.bincount(leaf, minlength=len(left))
    for node in np.flatnonzero(left != NO_CHILD)[::-1]:
        counts[node] = counts[left[node]] + counts[right[node]]
    return counts
