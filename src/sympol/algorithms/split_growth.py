"""Growing a tree while it is trained: a leaf is split where the policy gradient differs on the two sides.

A random tree tests features that happen to be drawn, and gradients have to replace them one by one. Here the tree
begins as a single leaf. After each rollout every sample has a gradient of the objective with respect to the outputs of
its leaf; a split is worth most where the sums of these gradients differ most between its sides, which is the criterion
of regression trees and of gradient boosting. A leaf is split only if its best split is better than the best of as many
random ones would be, so that noise alone never grows a tree. The two new leaves have the outputs of the old one: the
policy is the same before and after, and gradient descent does the rest.

A node of the complete tree that is not split yet is *closed*: all its thresholds are `MASKED`, everything goes left,
and its gradient is zero.
"""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int

from ..functional import leaf_index, select
from ..policies.distributions import Distribution
from ..policies.embed import MARGIN
from ..policies.tree import MASKED, Tree

FEWEST = 8
"""Samples that each side of a new split must have."""

NUM_EDGES = 32
"""Thresholds that are tried for each feature: quantiles of the rollout."""

CHANCE = 0.05
"""The probability that a leaf is split where there is nothing to gain."""


def closed(tree: Tree, nodes: Any = True) -> Tree:
    """Return a tree without some of its nodes.

    Args:
        tree: A complete tree.
        nodes: The nodes to close, bool ``[nodes]``; by default all, which leaves a single leaf.

    Returns:
        The tree with these nodes closed.
    """
    are_closed = jnp.broadcast_to(jnp.asarray(nodes), tree.thresholds.shape[:1])
    thresholds = jnp.where(are_closed[:, None], MASKED, tree.thresholds)
    return eqx.tree_at(lambda t: t.thresholds, tree, thresholds)


def output_gradients(
    distribution: Distribution, tree: Tree, x: Array, action: Array, advantage: Array
) -> Float[Array, "batch outputs"]:
    """Compute the gradient of each sample's term of the policy gradient objective with respect to its outputs.

    Args:
        distribution: The distribution over actions.
        tree: The actor.
        x: Scaled observations ``[batch, features]``.
        action: The actions that were sampled.
        advantage: Their advantages.

    Returns:
        The gradients.
    """

    def log_prob(outputs: Array, action: Array) -> Array:
        return distribution.log_prob(outputs, tree.log_std, action)

    return advantage[:, None] * jax.vmap(jax.grad(log_prob))(tree.rollout()(x), action)


def grow(
    tree: Tree,
    x: Float[Array, "batch features"],
    gradients: Float[Array, "batch outputs"],
    num_valid: Int[Array, ""] | int,
    most_leaves: int,
) -> Tree:
    """Split the leaves for which the gradients of a rollout justify it.

    Args:
        tree: The actor.
        x: Scaled observations.
        gradients: What `output_gradients` returned.
        num_valid: Only so many of the first samples count.
        most_leaves: No leaf is split beyond so many.

    Returns:
        A tree with the same outputs for every observation.
    """
    num_nodes, num_features = tree.thresholds.shape
    num_leaves, batch = num_nodes + 1, x.shape[0]
    is_closed = tree.thresholds[:, 0] >= MASKED
    top = _closed_above(is_closed, num_leaves)
    leaf = leaf_index(*select(tree.feature_logits, tree.thresholds), x)
    leaf = jnp.where(jnp.arange(batch) < num_valid, leaf, num_leaves)  # out of range: dropped

    meant = x[jnp.arange(batch) % num_valid]
    edges = jnp.sort(meant, axis=0)[(jnp.arange(NUM_EDGES) * batch) // NUM_EDGES]
    gain, at = _best_splits(leaf, x, gradients, edges, num_leaves)
    feature, edge = at // NUM_EDGES, at % NUM_EDGES
    level = edges[edge, feature]
    column = x[:, feature]  # [batch, leaves]
    inside = leaf[:, None] == jnp.arange(num_leaves)[None]
    above = jnp.min(jnp.where(inside & (column > level[None]), column, jnp.inf), axis=0)
    threshold = 0.5 * level + 0.5 * above

    open_leaves = num_nodes - jnp.sum(is_closed) + 1
    can = (top < num_nodes) & (gain > _by_chance(gradients.shape[1], num_features * NUM_EDGES))
    can &= jnp.isfinite(threshold)
    rank = jnp.argsort(jnp.argsort(jnp.where(can, -gain, jnp.inf)))
    chosen = can & (rank < most_leaves - open_leaves)
    node = jnp.where(chosen, top, num_nodes)  # out of range where nothing is split

    row = jnp.argmax(inside, axis=0)
    is_feature = jnp.arange(num_features)[None] == feature[:, None]
    placed = jnp.where(is_feature, threshold[:, None], x[row])
    old = tree.feature_logits[jnp.minimum(node, num_nodes - 1)]
    logits = jnp.where(is_feature, jnp.max(old, axis=1, keepdims=True) + MARGIN, old)
    right = jnp.where(chosen, _leftmost_leaf(2 * top + 2, num_nodes), num_leaves)
    return eqx.tree_at(
        lambda t: (t.feature_logits, t.thresholds, t.leaf_values),
        tree,
        (
            tree.feature_logits.at[node].set(logits, mode="drop"),
            tree.thresholds.at[node].set(placed, mode="drop"),
            tree.leaf_values.at[right].set(tree.leaf_values, mode="drop"),
        ),
    )


def _closed_above(is_closed: Array, num_leaves: int) -> Int[Array, " leaves"]:
    """Return, for each leaf, the highest node above it with nothing but closed nodes from there on down."""
    node = top = jnp.arange(num_leaves) + len(is_closed)
    still = jnp.ones(num_leaves, bool)
    for _ in range(num_leaves.bit_length() - 1):
        parent = (node - 1) // 2
        still &= is_closed[parent]
        top, node = jnp.where(still, parent, top), parent
    return top


def _leftmost_leaf(node: Array, num_nodes: int) -> Int[Array, " leaves"]:
    """Return the leaf at the left end below each node."""
    for _ in range((num_nodes + 1).bit_length() - 1):
        node = jnp.where(node < num_nodes, 2 * node + 1, node)
    return node - num_nodes


def _best_splits(
    leaf: Array, x: Array, gradients: Array, edges: Array, num_leaves: int
) -> tuple[Array, Array]:
    """Return the best gain of each leaf, and the feature and edge it is for as one number."""
    num_features = x.shape[1]
    moments = jnp.concatenate([gradients, gradients**2, jnp.ones_like(gradients[:, :1])], axis=1)
    bins = jax.vmap(lambda e, c: jnp.searchsorted(e, c, side="left"), (1, 1), 1)(edges, x)  # edges below x
    cell = (leaf[:, None] * num_features + jnp.arange(num_features)[None]) * (NUM_EDGES + 1) + bins
    sums: Any = jnp.zeros((num_leaves * num_features * (NUM_EDGES + 1), moments.shape[1]))
    sums = sums.at[cell.reshape(-1)].add(jnp.repeat(moments, num_features, axis=0), mode="drop")
    sums = sums.reshape(num_leaves, num_features, NUM_EDGES + 1, -1)
    left = jnp.cumsum(sums, axis=2)[:, :, :-1]
    total = jnp.sum(sums, axis=2, keepdims=True)
    size = gradients.shape[1]
    (n_left, n_right, n) = (a[..., -1:] for a in (left, total - left, total))
    variance = total[..., size : 2 * size] / jnp.maximum(n, 1)
    of_left, of_right = left[..., :size], total[..., :size] - left[..., :size]
    split = of_left**2 / jnp.maximum(n_left, 1) + of_right**2 / jnp.maximum(n_right, 1)
    improvement = split - total[..., :size] ** 2 / jnp.maximum(n, 1)
    gain = jnp.sum(jnp.where(variance > 0, improvement / jnp.maximum(variance, 1e-30), 0), axis=-1)
    enough = (jnp.minimum(n_left, n_right) >= FEWEST)[..., 0]
    flat = jnp.where(enough, gain, -jnp.inf).reshape(num_leaves, -1)
    return jnp.max(flat, axis=1), jnp.argmax(flat, axis=1)


def _by_chance(outputs: int, tried: int) -> float:
    """Return the gain that the best of so many random splits exceeds with probability `CHANCE`.

    The gain of one is about chi-squared with a degree of freedom for each output; the bound is that of Laurent and
    Massart (2000), lemma 1.
    """
    q = math.log(tried / CHANCE)
    return outputs + 2 * math.sqrt(outputs * q) + 2 * q
