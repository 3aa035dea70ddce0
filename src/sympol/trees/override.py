"""Overrides: a rule on top of a tree that decides wherever a condition holds, and the nodes a condition concerns.

    edited = override(tree, "pole angle > 0.1 and cart velocity > 0", "push right")

The condition is a property's ``when`` (`sympol.trees.verify.grammar`). Each of its cases becomes a chain of
questions from the root down, where every other answer leads on to the tree as it was, without what the questions
above have decided. So the rule adds few nodes to a small tree, and holds by construction: `verify` proves it.

A number of the condition is exact, as in all properties. A tree cannot ask whether a number is NaN: where the
condition says that a feature is greater than something, and nothing that it is less, NaN is greater, as it is
everywhere in a tree.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic, NamedTuple

import numpy as np

from .base import BaseTree, TreeT
from .boxes import Boxes, node_boxes, space
from .edit import checked_threshold, leaf_tree, split_tree
from .floats import next_below
from .name_lookup import Action, leaf_value
from .prune import prune
from .text_parser import CATEGORY
from .verify.conditions import boxes_of, split_boxes
from .verify.grammar import parse_condition

_MOST_QUESTIONS = 500
"""Cases that have nothing to do with each other multiply; a rule of more questions is none that somebody reads."""


class Edited(NamedTuple, Generic[TreeT]):
    """An edited tree and the nodes that the edit made, which training can freeze."""

    tree: TreeT
    nodes: tuple[int, ...]


def override(tree: TreeT, condition: str, action: Action) -> Edited[TreeT]:
    """Return the tree that takes an action wherever a condition holds and acts as before everywhere else.

    Args:
        tree: The tree.
        condition: A property's ``when``, such as ``"pole angle > 0.1 and cart velocity > 0"``.
        action: A name or a number; an option for each component; numbers where it is continuous.

    Returns:
        The edited tree and the numbers of the nodes that are the rule.

    Args:
        tree: The tree to change; it stays as it is.
        condition: Where the action is taken, as after ``when`` in a property.
        action: The action: a name, a number, or one for each component.

    Returns:
        The changed tree, and the numbers of the nodes that are the rule.

    Raises:
        ValueError: If the condition cannot be parsed, names what the tree does not have, or never holds; or if there
            is no such action.
        TypeError: If the action is of another type.
    """
    rule = _marked(leaf_tree(tree, leaf_value(tree.actions, action)), visits=1)
    asked = parse_condition(condition, tree)
    if not len(boxes_of(asked, space(tree, bounds=False))):
        raise ValueError(f"no observation meets the condition {condition!r}: there is nothing to override")
    # whole numbers are compared as numbers: the rule holds, and reads, as it was written
    everything = space(replace(tree, integers=()), bounds=False)
    boxes = boxes_of(asked, everything)
    cases = [_Case(boxes[[i]], _questions(tree, boxes[[i]], everything)) for i in range(len(boxes))]
    growing = _Growing(rule, _marked(tree, visits=0))
    grown = prune(growing.grown(everything, cases), bounds=False, merge=False)
    assert grown.n_node_samples is not None
    # what leads to the rule's leaves is the rule: in the branches of the tree as it was there are none
    nodes = tuple(np.flatnonzero(grown.n_node_samples).tolist())
    return Edited(replace(grown, n_node_samples=None), nodes)


def nodes_reached_by(tree: BaseTree, condition: str) -> tuple[int, ...]:
    """Return the nodes that observations satisfying a condition reach.

    As long as these nodes stay as they are, so does the policy wherever the condition holds.

    Args:
        tree: The tree.
        condition: A property's ``when``, such as ``"pole angle > 0.1 and cart velocity > 0"``.

    Returns:
        The numbers of the nodes, in order.

    Raises:
        ValueError: If the condition cannot be parsed, names what the tree does not have, or never holds.
    """
    meant = boxes_of(parse_condition(condition, tree), space(tree, bounds=False))
    if not len(meant):
        raise ValueError(f"no observation meets the condition {condition!r}")
    nodes = node_boxes(tree, bounds=False)
    reached = np.zeros(tree.n_nodes, bool)
    for box in range(len(meant)):
        reached |= ~nodes.intersect(meant[[box]]).is_empty
    return tuple(np.flatnonzero(reached).tolist())


class _Case(NamedTuple):
    """One box of the condition, and the splits that decide whether an observation is in it."""

    box: Boxes
    questions: tuple[tuple[int, float], ...]


def _questions(tree: BaseTree, box: Boxes, everything: Boxes) -> tuple[tuple[int, float], ...]:
    """Return the splits, as features and thresholds, that separate a box from everything else."""
    asked: list[tuple[int, float]] = []
    low, high = box.low[0], box.high[0]
    for group in tree.groups:
        possible = [feature for feature in group.features if high[feature] >= 1]
        asked_of = possible if len(possible) == 1 else [f for f in group.features if high[f] < 1]
        asked += [(feature, CATEGORY) for feature in asked_of]
    for feature in (i for i in range(tree.n_features) if i not in tree.group_of):
        if low[feature] > everything.low[0, feature]:
            below = float(next_below(low[feature])) + 0.0  # never -0.0, which is the same and reads worse
            asked.append((feature, checked_threshold(below)))
        if high[feature] < everything.high[0, feature]:
            asked.append((feature, checked_threshold(float(high[feature]))))
    return tuple(sorted(asked))


@dataclass
class _Growing(Generic[TreeT]):
    """The construction of a rule on top of a tree."""

    rule: TreeT
    tree: TreeT
    n_questions: int = 0

    def grown(self, region: Boxes, cases: list[_Case]) -> TreeT:
        """Return the splits a region leaves undecided, with the rule where all hold and the tree elsewhere."""
        while cases and cases[0].box.intersect(region).is_empty[0]:
            cases = cases[1:]
        if not cases:
            return self.tree
        for feature, threshold in cases[0].questions:
            left, right = split_boxes(region, np.array([feature]), np.array([threshold], np.float32))
            if not left.is_empty[0] and not right.is_empty[0]:
                self.n_questions += 1
                if self.n_questions > _MOST_QUESTIONS:
                    raise ValueError(
                        f"the condition asks more than {_MOST_QUESTIONS} questions; split it into simpler conditions, "
                        "each an override of its own"
                    )
                return split_tree(feature, threshold, self.grown(left, cases), self.grown(right, cases))
        return self.rule


def _marked(tree: TreeT, *, visits: int) -> TreeT:
    """Return the tree with this number of visits at each leaf, as marks that pruning preserves."""
    marks = np.where(tree.is_leaf, visits, 0)
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        marks[node] = marks[tree.children_left[node]] + marks[tree.children_right[node]]
    return replace(tree, n_node_samples=marks)
