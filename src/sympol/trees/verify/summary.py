"""What is known of every action without asking: where it is taken at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, leaf_boxes, space
from ..floats import next_below, number, printable

if TYPE_CHECKING:
    from jaxtyping import Int


@final
@dataclass(frozen=True, eq=False)
class Taken:
    """Where an action is taken."""

    action: str
    """In words."""
    leaves: Int[np.ndarray, " leaves"]
    """Those that take it and can be reached."""
    only_where: str
    """What is true of every observation that gets it, in words; empty where that is nothing."""


def taken(tree: BaseTree, *, within_bounds: bool = True) -> tuple[Taken, ...]:
    """Return where each action is taken, those of most leaves first."""
    boxes, leaves = leaf_boxes(tree, bounds=within_bounds), np.flatnonzero(tree.is_leaf)
    reached = ~boxes.is_empty
    boxes, leaves = boxes[reached], leaves[reached]
    actions, which = np.unique(tree.leaf_actions[leaves], axis=0, return_inverse=True)
    start = space(tree, bounds=within_bounds)
    found = [
        Taken(
            ", ".join(tree.actions.words(action)),
            leaves[which == i],
            _hull_words(tree, boxes[which == i], start),
        )
        for i, action in enumerate(actions)
    ]
    return tuple(sorted(found, key=lambda one: -len(one.leaves)))


def _hull_words(tree: BaseTree, boxes: Boxes, start: Boxes) -> str:
    """The smallest box around boxes, in words; silent where it is as large as the space."""
    low, high = boxes.low.min(axis=0), boxes.high.max(axis=0)
    phrases = []
    for feature, name in enumerate(tree.feature_names):
        if feature in tree.group_of:
            continue
        above = low[feature] > start.low[0, feature]
        below = high[feature] < start.high[0, feature]
        words = printable(name)
        if below:
            words = f"{words} ≤ {number(high[feature])}"
        if above:
            # an open end says what the tree asks: the threshold, not the float32 next to it
            beyond = number(float(next_below(low[feature])))
            words = f"{beyond} < {words}" if below else f"{words} > {beyond}"
        if above or below:
            phrases.append(words)
    for group in tree.groups:
        gone = [f for f in group.features if high[f] == 0 < start.high[0, f]]
        left = [f for f in group.features if high[f] == 1]
        if gone:
            phrases.append(group.words(left[0]) if len(left) == 1 else group.words_without(gone))
    return " and ".join(phrases)
