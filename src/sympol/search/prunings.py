"""Prune moves: a split is removed, and one of its sides takes its place.

This is all that pruning can do: where the side is a leaf, a subtree becomes a leaf; at the root, the tree begins
further down; and where both sides were alike, they merge. Observations of both sides now
meet leaves there that were made for others; so each cut comes in two forms, with these leaves as they were, and with
answers nearest to what was done before: the most frequent action, or the mean of continuous ones.
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
    """A node, and what is to stand in its place."""

    node: int
    part: DecisionTree
    removed: int
    """Nodes that the tree has less."""
    change: float
    """How much otherwise it acts in the observations: in which part of them, or by which squared distance."""


class _Seen(NamedTuple):
    """Observations in the order of the leaves that they fall into, and what is done there."""

    x: Float32[np.ndarray, "steps features"]
    leaf: Int[np.ndarray, " steps"]
    answer: Float[np.ndarray, "steps outputs"]


def prune_moves(tree: DecisionTree, observations: Float32[np.ndarray, "steps features"]) -> list[PruneMove]:
    """List all prune moves of a tree, the ones that change least first; ``observations`` are what the tree acts on."""
    leaf = np.atleast_1d(tree.apply(observations))
    order = np.argsort(leaf, kind="stable")
    seen = _Seen(observations[order], leaf[order], _answers(tree)[leaf[order]])
    found: dict[
        tuple[int, DecisionTree], PruneMove
    ] = {}  # of two leaves the one may be refitted to be the other
    for node in np.flatnonzero(~tree.is_leaf).tolist():
        for cut in _at(tree, node, seen):
            found.setdefault((node, cut.part), cut)
    return sorted(found.values(), key=lambda cut: (cut.change, -cut.removed))


def apply_prunings(tree: DecisionTree, some: Iterable[PruneMove]) -> DecisionTree:
    """Apply several moves; of one within another only the outer counts."""
    return graft_all(tree, ((cut.node, cut.part) for cut in some))


def _answers(tree: DecisionTree) -> Float[np.ndarray, "nodes outputs"]:
    """What is done at each node, as numbers."""
    return tree.leaf_actions.reshape(tree.n_nodes, -1).astype(np.float64)


def _at(tree: DecisionTree, node: int, seen: _Seen) -> Iterator[PruneMove]:
    end, right = subtree_end(tree, node), int(tree.children_right[node])
    here = slice(*np.searchsorted(seen.leaf, [node, end]))
    x, leaf, wanted = seen.x[here], seen.leaf[here], seen.answer[here]
    for child, stop in ((node + 1, right), (right, end)):
        comes = (leaf < child) | (leaf >= stop)
        ends_in = leaf.copy()
        links = tree.children_left, tree.children_right, tree.feature, tree.threshold
        ends_in[comes] = descend(*links, x[comes], child)
        kept, removed = subtree(tree, child), end - node - (stop - child)
        at = ends_in - child
        for part in (kept, _refitted(kept, at, wanted, np.unique(at[comes]), tree.leaf_outputs[leaf])):
            if part is not None:
                yield PruneMove(node, part, removed, _change(part, at, wanted, len(seen.x)))


def _change(part: DecisionTree, at: Int[np.ndarray, " steps"], wanted: np.ndarray, number: int) -> float:
    given = _answers(part)[at]
    differs = (given != wanted).any(axis=1)
    if isinstance(part.actions, BoxActions):
        return float(np.square(given - wanted).sum() / number)
    return float(differs.sum() / number)


def _refitted(
    part: DecisionTree,
    at: Int[np.ndarray, " steps"],
    wanted: Float[np.ndarray, "steps outputs"],
    touched: Int[np.ndarray, " leaves"],
    values: Float32[np.ndarray, "steps outputs"],
) -> DecisionTree | None:
    """The part with other answers at the leaves that were touched; None where they stay."""
    value = part.leaf_outputs.copy()
    for leaf in touched:
        rows = at == leaf
        if isinstance(part.actions, BoxActions):
            value[leaf] = wanted[rows].mean(axis=0)
        else:
            value[leaf] = _most_frequent(wanted[rows], values[rows])
    if _answers(part).tobytes() == _answers(new := replace(part, value=value)).tobytes():
        return None
    return new


def _most_frequent(
    wanted: Float[np.ndarray, "rows n"], values: np.ndarray
) -> Float32[np.ndarray, " outputs"]:
    """The value of the leaf that most come from of those who did what most did."""
    _, which, counts = np.unique(wanted, axis=0, return_inverse=True, return_counts=True)
    mine = values[which.ravel() == np.argmax(counts)]
    leaves, counts = np.unique(mine, axis=0, return_counts=True)
    return leaves[np.argmax(counts)]
