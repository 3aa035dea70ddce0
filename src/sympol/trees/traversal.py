"""How observations go through a tree: along the links from a node down to a leaf, and what counts on the way.

``left``, ``right``, ``feature`` and ``threshold`` are a `DecisionTree`'s arrays, or some of them changed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .preorder import NO_CHILD

if TYPE_CHECKING:
    from jaxtyping import Bool, Float32, Int, Int32

    Links = Int[np.ndarray, " nodes"]


def descend(
    left: Links,
    right: Links,
    feature: Int32[np.ndarray, " nodes"],
    threshold: Float32[np.ndarray, " nodes"],
    x: Float32[np.ndarray, "batch features"],
    root: int = 0,
) -> Int32[np.ndarray, " batch"]:
    """The leaf in which each observation ends that starts from ``root``."""
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
    """The same for one observation: NumPy would take longer over each step than Python over them all."""
    node = 0
    while left[node] != NO_CHILD:
        node = left[node] if x[feature[node]] <= threshold[node] else right[node]
    return node


def depths(left: Links, right: Links) -> Links:
    """Comparisons above each node; the nodes are in preorder."""
    depth = np.zeros(len(left), np.int64)
    for node in np.flatnonzero(left != NO_CHILD):
        depth[[left[node], right[node]]] = depth[node] + 1
    return depth


def paths(left: Links, right: Links, leaf: Int[np.ndarray, " batch"]) -> Bool[np.ndarray, "batch nodes"]:
    """Which nodes those come by who end in these leaves; the nodes are in preorder."""
    on_path = np.zeros((leaf.size, len(left)), dtype=bool)
    on_path[np.arange(leaf.size), leaf] = True
    for node in np.flatnonzero(left != NO_CHILD)[::-1]:
        on_path[:, node] = on_path[:, left[node]] | on_path[:, right[node]]
    return on_path


def visits(left: Links, right: Links, leaf: Int[np.ndarray, " batch"]) -> Links:
    """How many come by each node who end in these leaves; the nodes are in preorder."""
    counts = np.bincount(leaf, minlength=len(left))
    for node in np.flatnonzero(left != NO_CHILD)[::-1]:
        counts[node] = counts[left[node]] + counts[right[node]]
    return counts
