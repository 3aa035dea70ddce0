"""Smaller trees that act the same where it matters: on all the observations there can be.

Groups and bounds say much of what cannot be seen, but not all: behind a wall that is in front nothing is seen, and
no one-hot group knows. Where a world is small enough for all its observations to be listed, the list knows.

As in `sympol.trees.prune`, idle splits are found from the leaves up, and after one call nothing is left for
another: more observations may come by a split once one above it is gone, never fewer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .base import TreeT
from .floats import observation_batch
from .preorder import NO_CHILD, descend, paths

if TYPE_CHECKING:
    from jaxtyping import Int
    from numpy.typing import ArrayLike


def prune_on(tree: TreeT, observations: ArrayLike, *, merge: bool = True) -> TreeT:
    """Return the smaller tree that acts the same, deterministically, on each of these observations.

    On all others it may act differently: give all that can occur. A split goes when one side, asked for both, gives
    the same actions, as it does when none of them pass on the other; where either side can, the smaller one stays.
    Without ``merge`` it must give them out of the same leaves. The leaves keep their values, and nothing is known
    of visits afterwards: `DecisionTree.with_visits` counts them.

    Raises:
        ValueError: no observations, or of another shape, or groups that are not one-hot in them.
        TypeError: not numbers.
    """
    X, _ = observation_batch(observations, tree.n_features)
    if len(X) == 0:
        raise ValueError("there must be at least one observation to prune on, got none")
    X = np.unique(X, axis=0)
    leaf = np.atleast_1d(tree.apply(X))
    answer = _numbered(tree.leaf_actions) if merge else np.arange(tree.n_nodes)
    wanted = answer[leaf]
    come_by = paths(tree.children_left, tree.children_right, leaf).T
    left, right = tree.children_left.copy(), tree.children_right.copy()
    in_place, n_leaves = np.arange(tree.n_nodes), np.ones(tree.n_nodes, int)
    for node in np.flatnonzero(~tree.is_leaf)[::-1]:
        sides = left[node], right[node] = int(in_place[left[node]]), int(in_place[right[node]])
        n_leaves[node] = n_leaves[[*sides]].sum()
        here = come_by[node]
        for side in sorted(sides, key=lambda side: n_leaves[side]):
            found = descend(left, right, tree.feature, tree.threshold, X[here], side)
            if (answer[found] == wanted[here]).all():
                in_place[node] = side
                break
    return packed(tree, left, right, int(in_place[0]))


def _numbered(actions: np.ndarray) -> Int[np.ndarray, " nodes"]:
    """A number for each action, the same where they are, bit for bit."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(action.tobytes(), len(numbers)) for action in actions])


def packed(
    tree: TreeT, left: Int[np.ndarray, " nodes"], right: Int[np.ndarray, " nodes"], root: int
) -> TreeT:
    """The tree below ``root`` along these links, in preorder."""
    order, awaited = [], [root]
    while awaited:
        order.append(node := awaited.pop())
        if left[node] != NO_CHILD:
            awaited += [right[node], left[node]]
    position = np.full(tree.n_nodes, NO_CHILD)
    position[order] = np.arange(len(order))
    leaf = left[order] == NO_CHILD
    return replace(
        tree,
        children_left=np.where(leaf, NO_CHILD, position[left[order]]),
        children_right=np.where(leaf, NO_CHILD, position[right[order]]),
        feature=tree.feature[order],
        threshold=tree.threshold[order],
        value=tree.leaf_outputs[order],
        n_node_samples=None,
    )
