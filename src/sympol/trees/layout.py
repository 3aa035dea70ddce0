"""Where the nodes of a drawn tree go: a tidy tree, as narrow as labels of different sizes allow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .base import BaseTree

if TYPE_CHECKING:
    from jaxtyping import Bool, Float


def tidy(
    tree: BaseTree,
    size: Float[np.ndarray, " nodes"],
    gap: float,
    right_first: Bool[np.ndarray, " nodes"] | None = None,
) -> Float[np.ndarray, " nodes"]:
    """Return each node's centre along the axis on which siblings lie side by side; the least edge is at 0.

    Subtrees are moved together until, on some level, their outlines are ``gap`` apart, and a parent stands
    midway above its children. So the same subtree always looks the same, nodes on one level never overlap,
    and a left subtree stays on the left, or on the right below the nodes in ``right_first`` (Reingold and
    Tilford, 1981, with outlines kept level by level).
    """
    swapped = np.zeros(tree.n_nodes, dtype=bool) if right_first is None else right_first
    first = np.where(swapped, tree.children_right, tree.children_left)
    second = np.where(swapped, tree.children_left, tree.children_right)
    offset = np.zeros(tree.n_nodes)  # from the parent
    outlines: list[tuple[np.ndarray, np.ndarray]] = []  # a subtree's two sides, level by level, from its root
    for node in reversed(range(tree.n_nodes)):
        half = np.array([size[node] / 2])
        if tree.is_leaf[node]:
            outlines.append((-half, half))
            continue
        left, right = outlines.pop(), outlines.pop()
        (low_1, high_1), (low_2, high_2) = (right, left) if swapped[node] else (left, right)
        shared = min(len(low_1), len(low_2))
        step = (high_1[:shared] - low_2[:shared]).max() / 2 + gap / 2
        offset[first[node]], offset[second[node]] = -step, step
        low = np.concatenate([-half, low_1 - step, low_2[shared:] + step])
        high = np.concatenate([half, high_2 + step, high_1[shared:] - step])
        outlines.append((low, high))
    centre = offset
    centre[0] = -outlines[0][0].min()
    for node in np.flatnonzero(~tree.is_leaf):
        centre[tree.children_left[node]] += centre[node]
        centre[tree.children_right[node]] += centre[node]
    return centre


def levels(tree: BaseTree, size: Float[np.ndarray, " nodes"], gap: float) -> Float[np.ndarray, " nodes"]:
    """Return each node's centre along the axis on which children follow parents; the root's edge is at 0."""
    depth = tree.node_depth
    thickness = np.zeros(depth.max() + 1)
    np.maximum.at(thickness, depth, size)
    centre = np.cumsum(thickness + gap) - thickness / 2 - gap
    return centre[depth]
