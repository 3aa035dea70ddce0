"""Sends boxes down a tree: which part of each ends in which leaf."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, check_size
from ..floats import next_above

if TYPE_CHECKING:
    from jaxtyping import Float, Int


class Arrivals(NamedTuple):
    """Parts of boxes, none of them empty, and where they end."""

    boxes: Boxes
    leaf: Int[np.ndarray, " parts"]
    origin: Int[np.ndarray, " parts"]
    """Which of the boxes that were sent each is a part of."""


def send(boxes: Boxes, tree: BaseTree) -> Arrivals:
    """Part boxes by the leaves of a tree in which their observations end.

    All parts go down together, level by level, and those that are empty no further: the time is in proportion to
    what is met, not to the leaves times the boxes.

    Raises:
        ValueError: if there are too many parts to be kept.
    """
    here = np.flatnonzero(~boxes.is_empty)
    boxes, origin, node = boxes[here], here, np.zeros(len(here), np.int64)
    done: list[Arrivals] = []
    n_done = 0
    while len(boxes):
        at_leaf = tree.is_leaf[node]
        n_done += int(at_leaf.sum())
        check_size(n_done + len(boxes), tree.n_features)
        done.append(Arrivals(boxes[at_leaf], node[at_leaf], origin[at_leaf]))
        boxes, origin, node = boxes[~at_leaf], origin[~at_leaf], node[~at_leaf]
        left, right = sides(boxes, tree.feature[node], tree.threshold[node])
        boxes = left.joined([right])
        origin = np.concatenate([origin, origin])
        node = np.concatenate([tree.children_left[node], tree.children_right[node]])
        kept = ~boxes.is_empty
        boxes, origin, node = boxes[kept], origin[kept], node[kept]
    none = np.zeros(0, np.int64)
    return Arrivals(
        boxes.joined([part.boxes for part in done]),
        np.concatenate([none, *(part.leaf for part in done)]),
        np.concatenate([none, *(part.origin for part in done)]),
    )


def sides(boxes: Boxes, feature: np.ndarray, threshold: np.ndarray) -> tuple[Boxes, Boxes]:
    """What of each box goes left and what goes right of a split, one a box."""
    rows = np.arange(len(boxes))
    high, nan, low = boxes.high.copy(), boxes.nan.copy(), boxes.low.copy()
    high[rows, feature] = np.minimum(high[rows, feature], threshold)
    nan[rows, feature] = False
    low[rows, feature] = np.maximum(low[rows, feature], next_above(threshold))
    return replace(boxes, high=high, nan=nan), replace(boxes, low=low)


def numbers(tree: BaseTree, leaf: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n components"]:
    """Return the deterministic actions of leaves, a number a component, as claims speak of them."""
    return tree.leaf_actions.reshape(tree.n_nodes, -1)[leaf].astype(np.float64)


def acted(tree: BaseTree, observations: Sequence[np.ndarray]) -> Float[np.ndarray, "n components"]:
    """Return what a tree does in observations, in the same form, by asking the tree itself."""
    return np.reshape(tree.predict(np.stack(observations)), (len(observations), -1)).astype(np.float64)
