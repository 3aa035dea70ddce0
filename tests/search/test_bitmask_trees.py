"""Trees answered by bits in place of walking down."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from sympol.search.evaluators.packed_trees import ALL, MAX_LEAVES, BitmaskTrees

from .loops import grown, spec_of


def test_bits_are_the_leaf_that_walking_ends_in():
    """Also for NaN, infinite numbers, signed zeros, ties, and every shape of tree."""
    spec = spec_of("CartPole-v1")
    trees = [grown(spec, 1 + n % MAX_LEAVES, n) for n in range(96)]
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (40, 4)).astype(np.float32)
    special = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 0.5], np.float32)
    x = np.where(rng.random(x.shape) < 0.3, rng.choice(special, x.shape), x)
    forest = BitmaskTrees.of(trees, len(trees))
    which = np.repeat(np.arange(len(trees)), len(x))
    leaves = _leaves(forest, which, np.tile(x, (len(trees), 1))).reshape(len(trees), len(x))
    for tree, leaf in zip(trees, leaves, strict=True):
        np.testing.assert_array_equal(np.flatnonzero(tree.is_leaf)[leaf], tree.apply(x))


@jax.jit
def _apply(forest: BitmaskTrees, which: Any, x: Any) -> Any:
    return forest.apply(which, forest.tree_slices(which), x)


def _leaves(forest: BitmaskTrees, which: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.asarray(_apply(forest, which.astype(np.int32), x))


def test_many_features_are_looked_up():
    spec = spec_of("MiniGrid-LavaGapS5-v0")
    tree = grown(spec, 20, 3)
    rng = np.random.default_rng(0)
    x = np.zeros((200, len(spec.features.names)), np.float32)
    for group in spec.features.groups:
        x[np.arange(len(x)), rng.choice(group.features, len(x))] = 1
    forest, which = BitmaskTrees.of([tree], 1), np.zeros(len(x), int)
    leaf = _leaves(forest, which, x)
    assert len(np.unique(leaf)) > 2
    np.testing.assert_array_equal(np.flatnonzero(tree.is_leaf)[leaf], tree.apply(x))


def test_rows_beyond_the_nodes_clear_nothing():
    forest = BitmaskTrees.of([grown(spec_of("CartPole-v1"), 3, 0)], 2)
    assert (forest.mask[0, 2:] == ALL).all()
    assert (forest.mask[1] == ALL).all()
    assert forest.num_blocks == 1
