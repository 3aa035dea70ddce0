"""Trees as text: an indented listing, and one sentence for each leaf.

``≤`` is the tree's own comparison of float32 numbers, and ``>`` is its opposite: where an observation is NaN,
the answer is no. A split between the 0 and the 1 of a feature that is one-hot with others reads as what the 1
means: ``front is lava``. There yes is the right child, everywhere else the left one; `question` tells.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from .base import BaseTree
from .boxes import Boxes
from .floats import next_below, number, printable
from .groups import Group

MOST_CHARACTERS = 100_000_000
"""Most characters in a listing or in all sentences of a tree; a chain of depth 5,000 has as many."""


@dataclass(frozen=True)
class Question:
    """The question of an inner node, and the children that yes and no lead to."""

    words: str
    yes_child: int
    no_child: int


def question(tree: BaseTree, node: int, digits: int | None = None) -> Question:
    """Return the question of an inner node, with ``digits`` significant digits."""
    left, right = int(tree.children_left[node]), int(tree.children_right[node])
    feature = int(tree.feature[node])
    if (group := asked_group(tree, node)) is not None:
        return Question(group.words(feature), yes_child=right, no_child=left)
    words = f"{printable(tree.feature_names[feature])} ≤ {number(tree.threshold[node], digits)}"
    return Question(words, yes_child=left, no_child=right)


def asked_group(tree: BaseTree, node: int) -> Group | None:
    """Return the group about which an inner node asks whether it is one category; None if it asks for numbers."""
    return tree.group_of.get(int(tree.feature[node])) if 0 <= tree.threshold[node] < 1 else None


def to_text(tree: BaseTree, *, digits: int | None = None) -> str:
    """Write the tree as an indented listing, with the share of visits at each leaf where they are known.

    Thresholds are written in the fewest digits that give the same float32 back, or in ``digits`` significant
    ones. The text has no line break at its end.

    Raises:
        ValueError: if it would have more than `MOST_CHARACTERS`, as that of a chain thousands of comparisons deep.
    """
    lines: list[tuple[str, str]] = []
    awaited = [(0, "", "", "")]
    length = 0
    while awaited:
        node, above, label, further = awaited.pop()
        lines.append((above + label + node_words(tree, node, digits), visit_share(tree, node)))
        length = _counted(length, lines[-1][0])
        if not tree.is_leaf[node]:
            asked, indent = question(tree, node, digits), above + further
            awaited.append((asked.no_child, indent, "└─ no:  ", "   "))
            awaited.append((asked.yes_child, indent, "├─ yes: ", "│  "))
    width = max(len(line) for line, _ in lines)
    for line, share in lines:
        length = _counted(length, " " * (width - len(line)) if share else "")
    return "\n".join(f"{line:<{width}}  {share:>5}" if share else line.rstrip() for line, share in lines)


def rules(tree: BaseTree, *, digits: int | None = None) -> list[str]:
    """Write one sentence for each leaf, in the order of the listing.

    Several conditions on a feature become one interval, several on a group become one phrase.

    Raises:
        ValueError: if they would have more than `MOST_CHARACTERS`.
    """
    return checked_lines(rule_words(tree, leaf, known, digits) for leaf, known in leaf_conditions(tree))


def checked_lines(lines: Iterable[str]) -> list[str]:
    """Return lines of text about a tree, unless they are too long to hold in memory.

    A tree that is one long chain has lines as long as it is deep, all together in proportion to its size squared.

    Raises:
        ValueError: if they have more than `MOST_CHARACTERS`.
    """
    kept: list[str] = []
    length = 0
    for line in lines:
        length = _counted(length, line)
        kept.append(line)
    return kept


def _counted(length: int, line: str) -> int:
    """Return the length with one more line. Raises ValueError where that is too long."""
    if (length := length + len(line)) > MOST_CHARACTERS:
        raise ValueError(
            f"the tree is too deep to be written for people: it would take more than {MOST_CHARACTERS:,} characters; "
            "prune it, or export it as json or as a program"
        )
    return length


def leaf_conditions(tree: BaseTree) -> Iterator[tuple[int, Conditions]]:
    """Yield each leaf with the conditions on the path to it, in the order of the listing.

    The yielded conditions change with the next leaf: copy what must stay.
    """
    known: Conditions = {}
    # a node, and what the question above it tells of what; without a node, what was known of it before
    awaited: list[tuple[int | None, int | Group, Interval | Choice | None]] = []

    def enter(node: int) -> Iterator[int]:
        """Yield the node if it is a leaf, else schedule its children."""
        if tree.is_leaf[node]:
            yield node
            return
        feature, threshold = int(tree.feature[node]), float(tree.threshold[node])
        asked, group = question(tree, node), asked_group(tree, node)
        about = feature if group is None else group
        before = known.get(about)
        new = before or (Interval(tree.feature_names[feature]) if group is None else Choice(group))
        awaited.append((None, about, before))
        for child, yes in ((asked.no_child, False), (asked.yes_child, True)):
            awaited.append((child, about, new.told(feature, threshold, yes=yes)))

    for leaf in enter(0):
        yield leaf, known
    while awaited:
        node, about, told = awaited.pop()
        if told is None:
            del known[about]
        else:
            known[about] = told
        if node is not None:
            for leaf in enter(node):
                yield leaf, known


def rule_words(tree: BaseTree, leaf: int, known: Conditions, digits: int | None = None) -> str:
    """Write the sentence of a leaf from the conditions on its path."""
    conditions = " and ".join(condition.words(digits) for condition in known.values())
    share = visit_share(tree, leaf)
    answer = node_words(tree, leaf, digits) + (f" ({share})" if share else "")
    return f"If {conditions}: {answer}." if conditions else f"Always: {answer}."


def node_words(tree: BaseTree, node: int, digits: int | None = None) -> str:
    """Return the question of an inner node, or the action of a leaf."""
    if tree.is_leaf[node]:
        return ", ".join(leaf_words(tree, node, digits))
    return question(tree, node, digits).words


def leaf_words(tree: BaseTree, leaf: int, digits: int | None = None) -> tuple[str, ...]:
    """Describe the action of a leaf, component by component."""
    return tree.actions.words(tree.leaf_actions[leaf], digits)


def visit_share(tree: BaseTree, leaf: int) -> str:
    """Return the share of visits that reached a leaf, such as ``62 %``; empty if unknown."""
    visits = tree.n_node_samples
    if visits is None or visits[0] == 0 or not tree.is_leaf[leaf]:
        return ""
    share = float(visits[leaf] / visits[0])
    if 0 < share < 0.005:
        return "<1 %"
    return ">99 %" if 0.995 <= share < 1 else f"{share:.0%}".replace("%", " %")


@dataclass(frozen=True)
class Interval:
    """The condition of a path on a feature: greater than ``above`` and at most ``most``, None for no limit."""

    name: str
    above: float | None = None
    most: float | None = None

    def told(self, feature: int, threshold: float, *, yes: bool) -> Interval:
        """Return the condition after one more answer."""
        if yes:
            return replace(self, most=threshold if self.most is None else min(self.most, threshold))
        return replace(self, above=threshold if self.above is None else max(self.above, threshold))

    def words(self, digits: int | None = None) -> str:
        """Return the condition as text: ``0 < x ≤ 1``."""
        name = printable(self.name)
        if self.above is None:
            return f"{name} ≤ {number(self.most or 0.0, digits)}"
        if self.most is None:
            return f"{name} > {number(self.above, digits)}"
        return f"{number(self.above, digits)} < {name} ≤ {number(self.most, digits)}"


@dataclass(frozen=True)
class Choice:
    """The condition of a path on a group: the features that must be 1, and those that must be 0."""

    group: Group
    is_one: tuple[int, ...] = ()
    is_zero: tuple[int, ...] = ()

    def told(self, feature: int, threshold: float, *, yes: bool) -> Choice:
        """Return the condition after one more answer."""
        if feature in (self.is_one if yes else self.is_zero):
            return self
        return (
            replace(self, is_one=(*self.is_one, feature))
            if yes
            else replace(self, is_zero=(*self.is_zero, feature))
        )

    def words(self, digits: int | None = None) -> str:
        """Return the condition as text: ``front is neither lava nor wall``."""
        left = [feature for feature in self.group.features if feature not in self.is_zero]
        if not self.is_one and len(left) != 1:
            return self.group.words_without(self.is_zero)
        # a tree that was not pruned may contradict itself, and then its rules do
        phrases = [self.group.words(feature) for feature in self.is_one or left]
        phrases += [
            self.group.words(feature, negated=True) for feature in self.is_one if feature in self.is_zero
        ]
        return " and ".join(phrases)


Conditions: TypeAlias = dict[int | Group, Interval | Choice]
"""Conditions on features, by position, and on groups."""


def format_region(tree: BaseTree, box: Boxes, space: Boxes) -> str:
    """Describe one box, such as ``0.1 < pole angle ≤ 0.2 and front is lava``; empty if it is the whole space.

    Args:
        tree: The tree whose features, groups and whole numbers are meant.
        box: One box, not empty.
        space: One box that contains it.

    Returns:
        The conditions that hold in the box and not in all of the space.
    """
    phrases: list[tuple[int, str]] = []
    narrower = (box.low[0] > space.low[0]) | (box.high[0] < space.high[0])
    for feature in np.flatnonzero(narrower).tolist():
        if feature not in tree.group_of:
            phrases.append((feature, _interval(tree, feature, box, space).words()))
    for group in tree.groups:
        gone = [f for f in group.features if box.high[0, f] < 1 <= space.high[0, f]]
        if gone:
            left = [f for f in group.features if box.high[0, f] >= 1]
            known = (
                Choice(group, is_one=tuple(left)) if len(left) == 1 else Choice(group, is_zero=tuple(gone))
            )
            phrases.append((min(group.features), known.words()))
    return " and ".join(words for _, words in sorted(phrases))


def _interval(tree: BaseTree, feature: int, box: Boxes, space: Boxes) -> Interval:
    low, high = box.low[0, feature], box.high[0, feature]
    whole = feature in tree.integers
    below = float(low) - 1 if whole else float(next_below(low))
    return Interval(
        tree.feature_names[feature],
        above=below if low > space.low[0, feature] else None,
        most=float(high) if high < space.high[0, feature] else None,
    )
