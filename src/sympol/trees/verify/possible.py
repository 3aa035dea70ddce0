"""What a policy can do at all, or under a condition."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..actions import BoxActions
from ..base import BaseTree
from ..boxes import space
from .arrivals import numbers, send
from .language import parse_condition
from .logic import ALWAYS, boxes_of


def possible_actions(tree: BaseTree, when: str = "", *, within_bounds: bool = True) -> np.ndarray:
    """Return every action that some observation gets, in order, each as `DecisionTree.predict` returns it.

    Args:
        tree: The policy.
        when: Only under this condition, such as ``"pole angle > 0.1"``; empty for every observation.
        within_bounds: Whether only observations within the bounds of the space count.

    Raises:
        ValueError: if the condition is none.
    """
    leaf = _leaves(tree, when, within_bounds)
    return np.unique(tree.leaf_actions[leaf], axis=0)


def action_range(
    tree: BaseTree, when: str = "", *, within_bounds: bool = True
) -> Mapping[str, tuple[float, float]]:
    """Return the least and the greatest that each number of a continuous action becomes; both are reached.

    The same arguments; nothing is returned where no observation meets the condition.

    Raises:
        ValueError: if the condition is none.
        TypeError: if actions are not continuous.
    """
    if not isinstance(tree.actions, BoxActions):
        raise TypeError("only continuous actions have a range; see possible_actions")
    leaf = _leaves(tree, when, within_bounds)
    if not len(leaf):
        return {}
    action = numbers(tree, leaf)
    ends = zip(tree.actions.names, action.min(axis=0).tolist(), action.max(axis=0).tolist(), strict=True)
    return {name: (low, high) for name, low, high in ends}


def _leaves(tree: BaseTree, when: str, within_bounds: bool) -> np.ndarray:
    condition = parse_condition(when, tree) if when else ALWAYS
    return np.unique(send(boxes_of(condition, space(tree, bounds=within_bounds)), tree).leaf)
