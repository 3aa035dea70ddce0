"""Differences of two trees: what changed, in words, and which states get another action.

As far as two trees ask the same from the root down they are compared node by node: other thresholds, other
answers, subtrees cut or grown. Below a place where they part, what counts is what they do: each region in which
the actions differ is told, exactly, with the action of either. Observations tell how much of it matters.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from .base import BaseTree
from .boxes import leaf_boxes, node_boxes, space
from .edit import require_same_space, subtree, subtree_end
from .text import format_region, leaf_words, question
from .verify.conditions import propagate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_AT_ONCE = 2**24
"""Intervals that are compared in one go, at most."""


@final
@dataclass(frozen=True)
class Change:
    """A change from one text to another in a region."""

    where: str
    before: str
    after: str

    @property
    def words(self) -> str:
        """The change as a sentence."""
        return f"{f'Where {self.where}' if self.where else 'Everywhere'}: {self.before} becomes {self.after}."


@final
@dataclass(frozen=True)
class Visited:
    """The effect of the changes on given observations."""

    n: int
    """The number of observations."""
    counts: Mapping[tuple[str, str], int]
    """The number of observations for each pair of old and new action, the largest first."""

    @property
    def n_changed(self) -> int:
        """The number of observations with another action."""
        return sum(self.counts.values())

    @property
    def share(self) -> float:
        """The share of observations with another action."""
        return self.n_changed / self.n if self.n else 0.0

    @property
    def words(self) -> str:
        """The change as a sentence."""
        kinds = "; ".join(f"{a} becomes {b} in {count:,}" for (a, b), count in self.counts.items())
        changed = f"{self.n_changed:,} of {self.n:,} states get another action ({100 * self.share:.2g} %)"
        return f"{changed}{': ' if kinds else ''}{kinds}."


@final
@dataclass(frozen=True)
class Difference:
    """All differences between two trees."""

    changes: tuple[Change, ...]
    acts_alike: bool
    """Whether every observation within the bounds gets the same action of both."""
    visited: Visited | None
    """None where no observations were given."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """One sentence for each change, and for the observations."""
        told = tuple(change.words for change in self.changes)
        if self.acts_alike:
            told += ("Both act alike on every observation within the bounds.",)
        return told if self.visited is None else (*told, self.visited.words)

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain JSON."""
        plain: dict[str, Any] = {
            "changes": [{"where": c.where, "before": c.before, "after": c.after} for c in self.changes],
            "acts_alike": self.acts_alike,
        }
        if self.visited is not None:
            counts = [{"before": a, "after": b, "states": n} for (a, b), n in self.visited.counts.items()]
            plain["visited"] = {
                "states": self.visited.n,
                "share_changed": self.visited.share,
                "changed": counts,
            }
        return plain

    def __str__(self) -> str:
        """Return the sentences, one on each line."""
        return "\n".join(self.sentences)


def diff(before: BaseTree, after: BaseTree, observations: ArrayLike | None = None) -> Difference:
    """Compare two trees.

    Args:
        before: The old tree.
        after: The new tree, of the same features, groups and actions.
        observations: States in which to count changed actions, [batch, features].

    Returns:
        The changes, exact and in words.

    Returns:
        The regions in which actions differ, and the counts of changed states.

    Raises:
        ValueError: If the trees are of different spaces, or the observations do not fit them.
        TypeError: If the observations do not hold numbers.
    """
    require_same_space(before, after)
    visited = (
        None if observations is None else _visited(before, after, np.atleast_2d(np.asarray(observations)))
    )
    alike = not any(regions(before, after))
    return Difference(tuple(_changes(before, after)), alike, visited)


def _visited(before: BaseTree, after: BaseTree, x: np.ndarray) -> Visited:
    leaves = np.stack([np.atleast_1d(before.apply(x)), np.atleast_1d(after.apply(x))], axis=1)
    counts: dict[tuple[str, str], int] = {}
    for (a, b), count in zip(*np.unique(leaves, axis=0, return_counts=True), strict=True):
        if _acts(before, a) != _acts(after, b):
            said = ", ".join(leaf_words(before, a)), ", ".join(leaf_words(after, b))
            counts[said] = counts.get(said, 0) + int(count)
    return Visited(len(x), dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))))


def _changes(before: BaseTree, after: BaseTree) -> Iterator[Change]:
    """Descend both trees together as long as their splits agree."""
    start, boxes = space(before, bounds=True), node_boxes(before, bounds=True)
    awaited = [(0, 0)]
    while awaited:
        a, b = awaited.pop()
        where = format_region(before, boxes[[a]], start)
        if before.is_leaf[a] and after.is_leaf[b]:
            if _acts(before, a) != _acts(after, b):
                yield Change(where, _said(before, a), _said(after, b))
        elif before.is_leaf[a] or after.is_leaf[b]:
            if any(regions(before, after, a)):
                yield Change(where, _all_said(before, a), _all_said(after, b))
        elif _asks(before, a) == _asks(after, b):
            sides = ("children_right", "children_left")
            awaited += [(int(getattr(before, side)[a]), int(getattr(after, side)[b])) for side in sides]
        elif (changed := _reworded(before, after, a, b)) is not None:
            for own, other in changed:
                where = format_region(before, boxes[[own]], start)
                yield Change(where, _said(before, own), _said(after, other))
        else:
            yield from regions(before, after, a)


def _reworded(before: BaseTree, after: BaseTree, a: int, b: int) -> list[tuple[int, int]] | None:
    """The nodes that differ, where the form below is the same and so are all features or most nodes; else None."""
    parts = subtree(before, a), subtree(after, b)
    if parts[0].children_left.tolist() != parts[1].children_left.tolist():
        return None
    differ = [
        (a + i, b + i)
        for i in range(parts[0].n_nodes)
        if _asks(parts[0], i) != _asks(parts[1], i) or _acts(parts[0], i) != _acts(parts[1], i)
    ]
    trained_on = parts[0].feature.tolist() == parts[1].feature.tolist()
    return differ if trained_on or len(differ) <= max(1, parts[0].n_nodes // 3) else None


def regions(before: BaseTree, after: BaseTree, node: int = 0) -> Iterator[Change]:
    """Yield all regions within the bounds in which two trees of one space act differently.

    The regions do not overlap. Only observations that reach ``node`` of the old tree count.
    """
    start, boxes = space(before, bounds=True), leaf_boxes(before, bounds=True)
    leaves = np.flatnonzero(before.is_leaf)
    below = np.flatnonzero((node <= leaves) & (leaves < subtree_end(before, node)))
    # some leaves after the others: all at once could be very many regions
    at_once = max(1, _AT_ONCE // (after.n_leaves * max(before.n_features, 1)))
    for some in np.array_split(below, -(-len(below) // at_once)):
        ends = propagate(boxes[some], after)
        for j in np.argsort(ends.origin, kind="stable"):
            leaf, end = int(leaves[some[ends.origin[j]]]), int(ends.leaf[j])
            if _acts(before, leaf) != _acts(after, end):
                yield Change(
                    format_region(before, ends.boxes[[j]], start), _said(before, leaf), _said(after, end)
                )


def _asks(tree: BaseTree, node: int) -> tuple[int, float]:
    return int(tree.feature[node]), float(tree.threshold[node])


def _acts(tree: BaseTree, leaf: int) -> list[float]:
    """Return the action of a leaf; empty for an inner node."""
    return tree.leaf_actions[leaf].ravel().tolist() if tree.is_leaf[leaf] else []


def _said(tree: BaseTree, node: int) -> str:
    """Describe the action of a leaf, or the question of an inner node."""
    if tree.is_leaf[node]:
        return ", ".join(leaf_words(tree, node))
    return f"“{question(tree, node).words}”"


def _all_said(tree: BaseTree, node: int) -> str:
    """Describe a node and the number of nodes below it."""
    n = subtree_end(tree, node) - node - 1
    return f"{_said(tree, node)} with {n} nodes below" if n else _said(tree, node)
