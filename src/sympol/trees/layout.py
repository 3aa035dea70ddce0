"""Where the nodes of a drawn tree go: a tidy tree, as narrow as labels of different sizes allow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .tree import DecisionTree

if TYPE_CHECKING:
    from jaxtyping import Float


def tidy(tree: DecisionTree, size: Float[np.ndarray, " nodes"], gap: float) -> Float[np.ndarray, " nodes"]:
    """Return each node's centre along the axis on which siblings lie side by side; the least edge is at 0.

    Subtrees are moved together until, on some level, their outlines are ``gap`` apart, and a parent stands
    midway above its children. So the same subtree always looks the same, nodes on one level never overlap,
    and a left subtree stays on the left (Reingold and Tilford, 1981, with outlines kept level by level).
    """
    offset = np.zeros(tree.n_nodes)  # from the parent
    outlines: list[tuple[np.ndarray, np.ndarray]] = []  # a subtree's two sides, level by level, from its root
    for node in reversed(range(tree.n_nodes)):
        half = np.array([size[node] / 2])
        if tree.is_leaf[node]:
            outlines.append((-half, half))
            continue
        (left_low, left_high), (right_low, right_high) = outlines.pop(), outlines.pop()
        shared = min(len(left_low), len(right_low))
        step = (left_high[:shared] - right_low[:shared]).max() / 2 + gap / 2
        offset[tree.children_left[node]], offset[tree.children_right[node]] = -step, step
        low = np.concatenate([-half, left_low - step, right_low[shared:] + step])
        high = np.concatenate([half, right_high + step, left_high[shared:] - step])
        outlines.append((low, high))
    centre = offset
    centre[0] = -outlines[0][0].min()
    for node in np.flatnonzero(~tree.is_leaf):
        centre[tree.children_left[node]] += centre[node]
        centre[tree.children_right[node]] += centre[node]
    return centre


def levels(tree: DecisionTree, size: Float[np.ndarray, " nodes"], gap: float) -> Float[np.ndarray, " nodes"]:
    """Return each node's centre along the axis on which children follow parents; the root's edge is at 0."""
    depth = tree.node_depth
    thickness = np.zeros(depth.max() + 1)
    np.maximum.at(thickness, depth, size)
    centre = np.cumsum(thickness + gap) - thickness / 2 - gap
    return centre[depth]
