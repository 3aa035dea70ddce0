"""Small trees side by side, answered without walking: by all their comparisons and one word of bits.

Each leaf is a bit, the leftmost the lowest. Who goes right at a node will not end in a leaf to its left: those bits are
cleared. When every node was asked, the lowest bit left is the leaf (Lucchese et al., 2015, QuickScorer). In place of a
gather for each step down, which a compiled program takes one at a time, these are comparisons of many lanes at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Float32, Int, UInt32
from numpy import ndarray

from ...trees import DecisionTree

MAX_LEAVES = 32
"""Bits of a word."""
BLOCK = 8
"""Nodes that are asked in one go; blocks beyond those of the largest tree are left out."""
FEW = 16
"""Features up to which one is chosen by comparing its number with all of theirs; beyond, by a gather."""
ALL = np.uint32(0xFFFFFFFF)


class Masked(NamedTuple):
    """Trees of up to `MAX_LEAVES` leaves. Nodes are inner ones, padded with such as clear nothing."""

    feature: Int[ndarray, "trees nodes"]
    threshold: Float32[ndarray, "trees nodes"]
    mask: UInt32[ndarray, "trees nodes"]
    """Without the leaves to the left of the node."""
    value: Float32[ndarray, "trees leaves outputs"]
    num_blocks: Int[ndarray, ""]

    @staticmethod
    def of(trees: Sequence[DecisionTree], num_trees: int) -> Masked:
        """Pack them; the rows beyond them are of no meaning."""
        rows, outputs = (num_trees, MAX_LEAVES), trees[0].actions.n_outputs
        most = max(tree.n_leaves for tree in trees) - 1
        masked = Masked(
            feature=np.zeros(rows, np.int32),
            threshold=np.zeros(rows, np.float32),
            mask=np.full(rows, ALL),
            value=np.zeros((*rows, outputs), np.float32),
            num_blocks=np.array(-(-most // BLOCK), np.int32),
        )
        for i, tree in enumerate(trees):
            inner = np.flatnonzero(~tree.is_leaf)
            # preorder: what is left of node n are the nodes from n + 1 to its right child
            before = np.concatenate([[0], np.cumsum(tree.is_leaf)]).astype(np.uint64)
            first, last = (np.uint64(1) << before[at] for at in (inner + 1, tree.children_right[inner]))
            own = np.arange(len(inner))
            masked.feature[i, own] = tree.feature[inner]
            masked.threshold[i, own] = tree.threshold[inner]
            masked.mask[i, own] = ~(last - first).astype(np.uint32)
            masked.value[i, : tree.n_leaves] = tree.leaf_outputs[tree.is_leaf]
        return masked

    def held(self, tree: Int[Array, " lanes"]) -> tuple[Array, ...]:
        """What a lane keeps of its tree, lanes last."""
        return tuple(jnp.asarray(part)[tree].T for part in (self.feature, self.threshold, self.mask))

    def apply(
        self, tree: Int[Array, " lanes"], held: tuple[Array, ...], x: Float[Array, "lanes features"]
    ) -> Int[Array, " lanes"]:
        """Which of its leaves each lane's tree ends in, counted from the left."""
        # as they are, not computed anew for each node: the step that led to them would be
        columns = jax.lax.optimization_barrier(x.T)

        def ask(block: Int[Array, ""], bits: UInt32[Array, " lanes"]) -> UInt32[Array, " lanes"]:
            start = block * BLOCK
            feature, threshold, mask = (jax.lax.dynamic_slice_in_dim(part, start, BLOCK) for part in held)
            for i in range(BLOCK):
                left = _looked_at(columns, feature[i]) <= threshold[i]
                bits = bits & jnp.where(left, ALL, mask[i])
            return bits

        bits = jax.lax.fori_loop(0, self.num_blocks, ask, jnp.full(len(x), ALL))
        return 31 - jax.lax.clz(bits & -bits).astype(jnp.int32)


def _looked_at(
    columns: Float[Array, "features lanes"], feature: Int[Array, " lanes"]
) -> Float[Array, " lanes"]:
    num_features, lanes = columns.shape
    if num_features > FEW:
        return columns.at[feature, jnp.arange(lanes)].get(mode="promise_in_bounds")
    chosen = columns[0]
    for other in range(1, num_features):
        chosen = jnp.where(feature == other, columns[other], chosen)
    return chosen
