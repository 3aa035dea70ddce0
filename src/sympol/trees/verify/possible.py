"""The actions that a tree can take, under a condition or anywhere, and where it takes each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..actions import BoxActions
from ..base import BaseTree
from ..boxes import Boxes, leaf_boxes, space
from ..text import format_region
from .conditions import ALWAYS, boxes_of, leaf_actions, propagate
from .grammar import parse_condition

if TYPE_CHECKING:
    from jaxtyping import Int


def possible_actions(tree: BaseTree, when: str = "", *, within_bounds: bool = True) -> np.ndarray:
    """Return every action that the tree takes in some observation, in order.

    Args:
        tree: The policy.
        when: A condition, such as ``"pole angle > 0.1"``; empty for every observation.
        within_bounds: Whether only observations within the bounds of the space count.

    Returns:
        Different actions, [actions, ...], each as `DecisionTree.predict` returns it.

    Raises:
        ValueError: If the condition cannot be parsed.
    """
    leaves = _leaves(tree, when, within_bounds)
    return np.unique(tree.leaf_actions[leaves], axis=0)


def action_range(
    tree: BaseTree, when: str = "", *, within_bounds: bool = True
) -> Mapping[str, tuple[float, float]]:
    """Return the least and the greatest value of each number of a continuous action; both are reached.

    Args:
        tree: The policy.
        when: A condition, such as ``"angular velocity > 1"``; empty for every observation.
        within_bounds: Whether only observations within the bounds of the space count.

    Returns:
        Both values by the name of the number; empty if no observation meets the condition.

    Raises:
        ValueError: If the condition cannot be parsed.
        TypeError: If the actions are not continuous.
    """
    if not isinstance(tree.actions, BoxActions):
        raise TypeError("only continuous actions have a range; see possible_actions")
    leaves = _leaves(tree, when, within_bounds)
    if not len(leaves):
        return {}
    action = leaf_actions(tree, leaves)
    ends = zip(tree.actions.names, action.min(axis=0).tolist(), action.max(axis=0).tolist(), strict=True)
    return {name: (low, high) for name, low, high in ends}


def _leaves(tree: BaseTree, when: str, within_bounds: bool) -> Int[np.ndarray, " leaves"]:
    condition = parse_condition(when, tree) if when else ALWAYS
    return np.unique(propagate(boxes_of(condition, space(tree, bounds=within_bounds)), tree).leaf)


@final
@dataclass(frozen=True, eq=False)
class ActionRegion:
    """An action and where a tree takes it.

    Args:
        action: The action in words.
        leaves: The leaves that take it and can be reached.
        only_where: In words, a condition that every observation with this action meets; empty if there is none.
    """

    action: str
    leaves: Int[np.ndarray, " leaves"]
    only_where: str


def action_regions(tree: BaseTree, *, within_bounds: bool = True) -> tuple[ActionRegion, ...]:
    """Return where a tree takes each of its actions, those of most leaves first.

    Args:
        tree: The policy.
        within_bounds: Whether only observations within the bounds of the space count.
    """
    boxes, leaves = leaf_boxes(tree, bounds=within_bounds), np.flatnonzero(tree.is_leaf)
    reachable = ~boxes.is_empty
    boxes, leaves = boxes[reachable], leaves[reachable]
    actions, which = np.unique(tree.leaf_actions[leaves], axis=0, return_inverse=True)
    start = space(tree, bounds=within_bounds)
    regions = [
        ActionRegion(
            ", ".join(tree.actions.words(action)),
            leaves[which == i],
            _hull_words(tree, boxes[which == i], start),
        )
        for i, action in enumerate(actions)
    ]
    return tuple(sorted(regions, key=lambda region: -len(region.leaves)))


def _hull_words(tree: BaseTree, boxes: Boxes, start: Boxes) -> str:
    """Describe the smallest box around boxes; return nothing where it is as large as the space."""
    hull = replace(
        boxes,
        low=boxes.low.min(axis=0, keepdims=True),
        high=boxes.high.max(axis=0, keepdims=True),
        nan=boxes.nan.any(axis=0, keepdims=True),
    )
    return format_region(tree, hull, start)
