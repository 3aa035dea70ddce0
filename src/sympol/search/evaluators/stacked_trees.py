"""Trees side by side, as one struct of arrays: what many of them do is asked in a few array operations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int
from numpy import ndarray

from ...envs.spec import EnvSpec
from ...play import fitted_actions
from ...trees import DecisionTree


class Packed(NamedTuple):
    """Trees padded to the same number of nodes; a leaf is its own child, so walking on changes nothing."""

    feature: Int[ndarray, "trees nodes"]
    threshold: Float32[ndarray, "trees nodes"]
    left: Int[ndarray, "trees nodes"]
    right: Int[ndarray, "trees nodes"]
    value: Float32[ndarray, "trees nodes outputs"]
    depth: Int[ndarray, ""]
    """Of the deepest."""

    @staticmethod
    def of(trees: Sequence[DecisionTree], num_trees: int, num_nodes: int) -> Packed:
        """Pack them; the rows beyond them are of no meaning."""
        rows, outputs = (num_trees, num_nodes), trees[0].actions.n_outputs
        packed = Packed(
            feature=np.zeros(rows, np.int32),
            threshold=np.zeros(rows, np.float32),
            left=np.zeros(rows, np.int32),
            right=np.zeros(rows, np.int32),
            value=np.zeros((*rows, outputs), np.float32),
            depth=np.array(max(tree.depth for tree in trees), np.int32),
        )
        for i, tree in enumerate(trees):
            own, leaf = np.arange(tree.n_nodes), tree.is_leaf
            packed.feature[i, own] = np.where(leaf, 0, tree.feature)
            packed.threshold[i, own] = tree.threshold
            packed.left[i, own] = np.where(leaf, own, tree.children_left)
            packed.right[i, own] = np.where(leaf, own, tree.children_right)
            packed.value[i, own] = tree.leaf_outputs
        return packed

    def apply(
        self, tree: Int[ndarray, " batch"], x: Float32[ndarray, "batch features"]
    ) -> Int[ndarray, " batch"]:
        """The leaf in which each observation ends in its own tree; observations are flushed."""
        node, row = np.zeros_like(tree), np.arange(len(tree))
        for _ in range(int(self.depth)):
            goes_left = x[row, self.feature[tree, node]] <= self.threshold[tree, node]
            node = np.where(goes_left, self.left[tree, node], self.right[tree, node])
        return node


def answers(packed: Packed, spec: EnvSpec) -> ndarray:
    """What each leaf of each tree does, as the environment takes it ``[trees, nodes, ...]``."""
    trees, nodes, outputs = packed.value.shape
    actions = fitted_actions(spec.actions.decide(packed.value.reshape(-1, outputs)), spec.action_space)
    return actions.reshape(trees, nodes, *actions.shape[1:])
