"""Many trees packed into arrays, so that a few array operations evaluate all of them.

`StackedTrees` are evaluated in NumPy. In a compiled program, large trees are evaluated by following their links
(`PointerTrees`), and small ones without (`BitmaskTrees`), by all their comparisons and
one word of bits: each leaf is a bit, the leftmost the lowest. An observation that goes right at a node cannot
reach a leaf to its left, so those bits are cleared; after all nodes, the lowest bit left is the leaf (Lucchese
et al., 2015, QuickScorer). In place of a gather for each level, which a compiled program takes one at a time,
these are comparisons of a whole batch at once.
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

from ...envs.spec import EnvSpec
from ...play import fitted_actions
from ...trees import DecisionTree


class StackedTrees(NamedTuple):
    """Trees padded to the same number of nodes; a leaf is its own child, so that further steps change nothing."""

    feature: Int[ndarray, "trees nodes"]
    threshold: Float32[ndarray, "trees nodes"]
    left: Int[ndarray, "trees nodes"]
    right: Int[ndarray, "trees nodes"]
    value: Float32[ndarray, "trees nodes outputs"]
    depth: Int[ndarray, ""]
    """The depth of the deepest tree."""

    @staticmethod
    def of(trees: Sequence[DecisionTree], num_trees: int, num_nodes: int) -> StackedTrees:
        """Pack trees.

        Args:
            trees: The trees.
            num_trees: The number of rows; those beyond the trees have no meaning.
            num_nodes: The number of nodes of a row.

        Returns:
            The packed trees.
        """
        rows, outputs = (num_trees, num_nodes), trees[0].actions.n_outputs
        packed = StackedTrees(
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
        """Return the leaf that each observation reaches.

        Args:
            tree: The number of the tree of each observation ``[batch]``.
            x: The observations ``[batch, features]``, with subnormal numbers flushed to 0.

        Returns:
            Numbers of nodes ``[batch]``.
        """
        node, row = np.zeros_like(tree), np.arange(len(tree))
        for _ in range(int(self.depth)):
            goes_left = x[row, self.feature[tree, node]] <= self.threshold[tree, node]
            node = np.where(goes_left, self.left[tree, node], self.right[tree, node])
        return node


def leaf_actions(packed: StackedTrees, spec: EnvSpec) -> ndarray:
    """Return the action of each leaf as the environment takes it.

    Args:
        packed: The trees.
        spec: The environment.

    Returns:
        Actions ``[trees, nodes, ...]``.
    """
    trees, nodes, outputs = packed.value.shape
    actions = fitted_actions(spec.actions.decide(packed.value.reshape(-1, outputs)), spec.action_space)
    return actions.reshape(trees, nodes, *actions.shape[1:])


class PointerTrees(NamedTuple):
    """`StackedTrees` with one row for each node of any tree, which suits gathers; work grows with the depth alone."""

    feature: Int[ndarray, " rows"]
    threshold: Float32[ndarray, " rows"]
    children: Int[ndarray, " rows*2"]
    """The rows of the left and the right child of each row."""
    value: Float32[ndarray, "trees nodes outputs"]
    depth: Int[ndarray, ""]

    @staticmethod
    def of(packed: StackedTrees) -> PointerTrees:
        """Convert stacked trees."""
        first = np.arange(packed.feature.size, step=packed.feature.shape[1], dtype=np.int32)[:, None, None]
        children = np.stack([packed.left, packed.right], axis=-1) + first
        flat = packed.feature.ravel(), packed.threshold.ravel(), children.ravel()
        return PointerTrees(*flat, packed.value, packed.depth)

    def tree_slices(self, tree: Int[Array, " lanes"]) -> tuple[Array, ...]:
        """Return nothing: a lane keeps no arrays of its tree."""
        return ()

    def apply(
        self, tree: Int[Array, " lanes"], tree_slices: tuple[Array, ...], x: Float[Array, "lanes features"]
    ) -> Int[Array, " lanes"]:
        """Return the node that each lane's observation reaches.

        Args:
            tree: The number of each lane's tree ``[lanes]``.
            tree_slices: What `tree_slices` returned for these trees.
            x: The observations ``[lanes, features]``.

        Returns:
            Numbers of nodes ``[lanes]``.
        """
        numbers, first = x.ravel(), jnp.arange(len(x)) * x.shape[1]

        def down(_: Int[Array, ""], row: Int[Array, " lanes"]) -> Int[Array, " lanes"]:
            goes_left = _at(numbers, first + _at(self.feature, row)) <= _at(self.threshold, row)
            return _at(self.children, 2 * row + jnp.where(goes_left, 0, 1))

        root = tree * self.value.shape[1]
        return jax.lax.fori_loop(0, self.depth, down, root) - root


def _at(values: Array | ndarray, index: Int[Array, " lanes"]) -> Array:
    return jnp.asarray(values).at[index].get(mode="promise_in_bounds")


MAX_LEAVES = 32
"""The bits of a word, and so the leaves of the largest tree."""
BLOCK = 8
"""Nodes that are evaluated at once; blocks beyond those of the largest tree are left out."""
FEW = 16
"""The most features for which one is selected by comparisons; with more of them, by a gather."""
ALL = np.uint32(0xFFFFFFFF)


class BitmaskTrees(NamedTuple):
    """Trees of up to `MAX_LEAVES` leaves, as their inner nodes; padding clears no bits."""

    feature: Int[ndarray, "trees nodes"]
    threshold: Float32[ndarray, "trees nodes"]
    mask: UInt32[ndarray, "trees nodes"]
    """The bits of all leaves but those to the left of the node."""
    value: Float32[ndarray, "trees leaves outputs"]
    num_blocks: Int[ndarray, ""]

    @staticmethod
    def of(trees: Sequence[DecisionTree], num_trees: int) -> BitmaskTrees:
        """Pack trees.

        Args:
            trees: The trees.
            num_trees: The number of rows; those beyond the trees have no meaning.

        Returns:
            The packed trees.
        """
        rows, outputs = (num_trees, MAX_LEAVES), trees[0].actions.n_outputs
        most = max(tree.n_leaves for tree in trees) - 1
        masked = BitmaskTrees(
            feature=np.zeros(rows, np.int32),
            threshold=np.zeros(rows, np.float32),
            mask=np.full(rows, ALL),
            value=np.zeros((*rows, outputs), np.float32),
            num_blocks=np.array(-(-most // BLOCK), np.int32),
        )
        for i, tree in enumerate(trees):
            inner = np.flatnonzero(~tree.is_leaf)
            # preorder: the left subtree of node n are the nodes from n + 1 to its right child
            before = np.concatenate([[0], np.cumsum(tree.is_leaf)]).astype(np.uint64)
            first, last = (np.uint64(1) << before[at] for at in (inner + 1, tree.children_right[inner]))
            own = np.arange(len(inner))
            masked.feature[i, own] = tree.feature[inner]
            masked.threshold[i, own] = tree.threshold[inner]
            masked.mask[i, own] = ~(last - first).astype(np.uint32)
            masked.value[i, : tree.n_leaves] = tree.leaf_outputs[tree.is_leaf]
        return masked

    def tree_slices(self, tree: Int[Array, " lanes"]) -> tuple[Array, ...]:
        """Return the arrays that each lane keeps of its tree, lanes last."""
        return tuple(jnp.asarray(part)[tree].T for part in (self.feature, self.threshold, self.mask))

    def apply(
        self, tree: Int[Array, " lanes"], tree_slices: tuple[Array, ...], x: Float[Array, "lanes features"]
    ) -> Int[Array, " lanes"]:
        """Return the leaf that each lane's observation reaches.

        Args:
            tree: The number of each lane's tree ``[lanes]``.
            tree_slices: What `tree_slices` returned for these trees.
            x: The observations ``[lanes, features]``.

        Returns:
            Numbers of leaves, counted from the left, ``[lanes]``.
        """
        # a barrier, or the step that led to them would be computed again for each node
        columns = jax.lax.optimization_barrier(x.T)

        def clear_bits(block: Int[Array, ""], bits: UInt32[Array, " lanes"]) -> UInt32[Array, " lanes"]:
            start = block * BLOCK
            feature, threshold, mask = (
                jax.lax.dynamic_slice_in_dim(part, start, BLOCK) for part in tree_slices
            )
            for i in range(BLOCK):
                left = _selected(columns, feature[i]) <= threshold[i]
                bits = bits & jnp.where(left, ALL, mask[i])
            return bits

        bits = jax.lax.fori_loop(0, self.num_blocks, clear_bits, jnp.full(len(x), ALL))
        return 31 - jax.lax.clz(bits & -bits).astype(jnp.int32)


def _selected(
    columns: Float[Array, "features lanes"], feature: Int[Array, " lanes"]
) -> Float[Array, " lanes"]:
    num_features, lanes = columns.shape
    if num_features > FEW:
        return columns.at[feature, jnp.arange(lanes)].get(mode="promise_in_bounds")
    chosen = columns[0]
    for other in range(1, num_features):
        chosen = jnp.where(feature == other, columns[other], chosen)
    return chosen
