"""The layout of a drawn tree: tidy, as narrow as labels of different sizes allow, downward or to the right."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from .base import BaseTree
from .plot_boxes import Pen

if TYPE_CHECKING:
    from jaxtyping import Bool, Float

# inches, on paper
_PAGE = (10.0, 7.0)
_MARGIN = 0.15


class Drawable(Protocol):
    """The box of a node."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, in inches."""
        ...

    def draw(self, pen: Pen, centre: Float[np.ndarray, " 2"]) -> None:
        """Draw the box around its centre."""
        ...


Boxes = TypeVar("Boxes", bound=Sequence[Drawable])


@dataclass(frozen=True)
class Layout:
    """The centres and sizes of all boxes, [nodes, 2], in inches from the upper left corner."""

    centre: Float[np.ndarray, "nodes 2"]
    size: Float[np.ndarray, "nodes 2"]
    downward: bool

    @property
    def extent(self) -> Float[np.ndarray, " 2"]:
        """Width and height of the picture."""
        return (self.centre + self.size / 2).max(axis=0) + _MARGIN


def lay_out(
    tree: BaseTree,
    boxes_when: Callable[[bool], Boxes],
    yes_is_right: Bool[np.ndarray, " nodes"] | None = None,
) -> tuple[Layout, Boxes]:
    """Lay boxes out downward if that is readable on a page, else to the right if that is better.

    ``boxes_when`` makes a box for every node, told whether the tree grows downward.
    """
    downward, down_boxes = _one_way(tree, boxes_when, yes_is_right, downward=True)
    rightward, right_boxes = _one_way(tree, boxes_when, yes_is_right, downward=False)

    def scale_on_page(layout: Layout) -> float:
        return min(1.0, float(np.min(np.sort(_PAGE) / np.sort(layout.extent))))

    if scale_on_page(downward) >= min(0.8, scale_on_page(rightward)):
        return downward, down_boxes
    return rightward, right_boxes


def _one_way(
    tree: BaseTree,
    boxes_when: Callable[[bool], Boxes],
    yes_is_right: Bool[np.ndarray, " nodes"] | None,
    *,
    downward: bool,
) -> tuple[Layout, Boxes]:
    boxes = boxes_when(downward)
    size = np.array([box.size for box in boxes])
    width, height = size.T
    if downward:
        x, y = tidy(tree, width, 0.12, yes_is_right), levels(tree, height, gap=0.45)
    else:
        x, y = levels(tree, width, gap=0.55), tidy(tree, height, 0.07, yes_is_right)
    return Layout(np.stack([x, y], axis=1) + _MARGIN, size, downward), boxes


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
