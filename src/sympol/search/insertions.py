"""How a tree can grow: a question above a node, where one side goes on as before and the other gets an answer.

Above a leaf that splits it. Above an inner node it takes a part of what comes there away from all that is below, which
else many leaves would have to split off together.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from ..trees import DecisionTree
from ..trees.edit import graft_all, leaf_tree, split_tree, subtree, subtree_end
from .moves import Leaf, Moves

PATIENCE = 4
"""How often as many as asked for are drawn, where some are alike or change nothing."""


class Sprout(NamedTuple):
    """A node, and what is to stand in its place."""

    node: int
    end: int
    """The first node behind those below it."""
    part: DecisionTree

    def is_apart_from(self, other: Sprout) -> bool:
        """Whether neither is above the other, so that a tree can have both."""
        return self.end <= other.node or other.end <= self.node


def sprouts(
    tree: DecisionTree,
    observations: Float32[np.ndarray, "steps features"],
    number: int,
    rng: np.random.Generator,
) -> list[Sprout]:
    """Different ones at random, ``number`` at most; ``observations`` are what the tree acts on.

    Each node that saw two different observations is as likely as any other, and so is each feature that differs
    there. The threshold lies between two values that were seen there. Where nothing ever differs there are none.
    """
    leaf = np.atleast_1d(tree.apply(observations))
    ends = [subtree_end(tree, node) for node in range(tree.n_nodes)]
    rows = [np.flatnonzero((leaf >= node) & (leaf < end)) for node, end in enumerate(ends)]
    nodes = [node for node, here in enumerate(rows) if (observations[here] != observations[here[:1]]).any()]
    if not nodes:
        return []
    moves = Moves.among(tree.actions, observations)
    found: dict[tuple[int, DecisionTree], Sprout] = {}
    for _ in range(PATIENCE * number):
        if len(found) == number:
            break
        node = nodes[int(rng.integers(len(nodes)))]
        here = rows[node]
        x, acted = observations[here], int(leaf[here[int(rng.integers(len(here)))]])
        value = moves.other_answer(Leaf(tuple(tree.leaf_outputs[acted].tolist())), rng).value
        other = leaf_tree(tree, np.array(value, np.float32))
        feature = int(rng.choice(np.flatnonzero((x != x[0]).any(axis=0))))
        values = np.unique(x[:, feature])
        at = int(rng.integers(len(values) - 1))
        sides = [subtree(tree, node), other]
        if rng.random() < 0.5:
            sides.reverse()
        threshold = values[at : at + 2].mean(dtype=np.float64)
        sprout = Sprout(node, ends[node], split_tree(feature, float(threshold), *sides))
        if not (tree.is_leaf[node] and _acts_as(tree, node, other)):
            found.setdefault((node, sprout.part), sprout)
    return list(found.values())


def grown(tree: DecisionTree, some: Iterable[Sprout]) -> DecisionTree:
    """The tree with all of these, of which none is above another."""
    return graft_all(tree, ((sprout.node, sprout.part) for sprout in some))


def _acts_as(tree: DecisionTree, leaf: int, other: DecisionTree) -> bool:
    return bool((tree.leaf_actions[leaf] == other.leaf_actions).all())
