"""Prune moves: a split is removed, and one of its sides takes its place.

This covers all that pruning can do: where the side is a leaf, a subtree becomes a leaf; at the root, the tree begins
further down; and where both sides were equal, they merge. Observations of the other side now reach leaves that were
made for others. So each move comes in two forms: with these leaves as they were, and with actions nearest to those
before, the most frequent one or the mean of continuous ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from ..trees import DecisionTree
from ..trees.actions import BoxActions
from ..trees.edit import graft_all, subtree, subtree_end
from ..trees.preorder import descend


class PruneMove(NamedTuple):
    """The replacement of a node's subtree by a smaller one."""

    node: int
    part: DecisionTree
    """The tree that takes the place of the node's subtree."""
    removed: int
    """The number of nodes that the tree loses."""
    change: float
    """How much its actions change: the part of observations in which they differ, or the mean squared distance."""


class _Seen(NamedTuple):
    """Observations in the order of the leaves that they reach, and the actions there."""

    x: Float32[np.ndarray, "steps features"]
    leaf: Int[np.ndarray, " steps"]
    action: Float[np.ndarray, "steps outputs"]


def prune_moves(tree: DecisionTree, observations: Float32[np.ndarray, "steps features"]) -> list[PruneMove]:
    """List all prune moves of a tree.

    Args:
        tree: The tree.
        observations: The observations ``[steps, features]`` that it acts on.

    Returns:
        The moves, those that change least first.
    """
    leaf = np.atleast_1d(tree.apply(observations))
    order = np.argsort(leaf, kind="stable")
    seen = _Seen(observations[order], leaf[order], _actions(tree)[leaf[order]])
    moves: dict[tuple[int, DecisionTree], PruneMove] = {}  # a refitted leaf may equal the other one
    for node in np.flatnonzero(~tree.is_leaf).tolist():
        for move in _moves_at(tree, node, seen):
            moves.setdefault((node, move.part), move)
    return sorted(moves.values(), key=lambda move: (move.change, -move.removed))


def apply_prunings(tree: DecisionTree, moves: Iterable[PruneMove]) -> DecisionTree:
    """Apply several prune moves.

    Args:
        tree: The tree.
        moves: Moves of this tree; of one within another only the outer counts.

    Returns:
        The smaller tree.
    """
    return graft_all(tree, ((move.node, move.part) for move in moves))


def _actions(tree: DecisionTree) -> Float[np.ndarray, "nodes outputs"]:
    """Return the action of each node as numbers."""
    return tree.leaf_actions.reshape(tree.n_nodes, -1).astype(np.float64)


def _moves_at(tree: DecisionTree, node: int, seen: _Seen) -> Iterator[PruneMove]:
    end, right = subtree_end(tree, node), int(tree.children_right[node])
    here = slice(*np.searchsorted(seen.leaf, [node, end]))
    x, leaf, before = seen.x[here], seen.leaf[here], seen.action[here]
    for child, stop in ((node + 1, right), (right, end)):
        moved = (leaf < child) | (leaf >= stop)
        ends_in = leaf.copy()
        links = tree.children_left, tree.children_right, tree.feature, tree.threshold
        ends_in[moved] = descend(*links, x[moved], child)
        side, removed = subtree(tree, child), end - node - (stop - child)
        at = ends_in - child
        for part in (side, _refitted(side, at, before, np.unique(at[moved]), tree.leaf_outputs[leaf])):
            if part is not None:
                yield PruneMove(node, part, removed, _change(part, at, before, len(seen.x)))


def _change(part: DecisionTree, at: Int[np.ndarray, " steps"], before: np.ndarray, number: int) -> float:
    after = _actions(part)[at]
    differs = (after != before).any(axis=1)
    if isinstance(part.actions, BoxActions):
        return float(np.square(after - before).sum() / number)
    return float(differs.sum() / number)


def _refitted(
    part: DecisionTree,
    at: Int[np.ndarray, " steps"],
    before: Float[np.ndarray, "steps outputs"],
    touched: Int[np.ndarray, " leaves"],
    values: Float32[np.ndarray, "steps outputs"],
) -> DecisionTree | None:
    """Return the part with refitted actions at the leaves that others reach now; None where they stay the same."""
    value = part.leaf_outputs.copy()
    for leaf in touched:
        rows = at == leaf
        if isinstance(part.actions, BoxActions):
            value[leaf] = before[rows].mean(axis=0)
        else:
            value[leaf] = _most_frequent(before[rows], values[rows])
    if _actions(part).tobytes() == _actions(new := replace(part, value=value)).tobytes():
        return None
    return new


def _most_frequent(
    before: Float[np.ndarray, "rows n"], values: np.ndarray
) -> Float32[np.ndarray, " outputs"]:
    """Return the value of the most frequent leaf among those with the most frequent action."""
    _, which, counts = np.unique(before, axis=0, return_inverse=True, return_counts=True)
    chosen = values[which.ravel() == np.argmax(counts)]
    leaves, counts = np.unique(chosen, axis=0, return_counts=True)
    return leaves[np.argmax(counts)]
