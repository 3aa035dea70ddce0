"""A decision tree of any shape as the parameters of a complete one, to train on from: `extract_tree` undone.

A leaf above the bottom becomes a subtree whose splits all lead to the same answer. Training can make use of them: once
their leaves learn from different observations, they differ, and then the splits have something to decide.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from ..functional.hard_tree import MAX_DEPTH, Surrogate
from ..trees import DecisionTree
from ..trees.actions import BoxActions, DiscreteActions
from ..trees.floats import flushed
from .tree import Tree

MARGIN = 1.0
"""The difference of the logit of a split's feature to the others. From 2 on entmax15 would give the others nothing, and
they could not recover."""

CERTAIN = 0.999
"""The highest probability of a leaf's action; with a higher one it would hardly ever try another, and learn nothing."""

LEAST_LOG_STD = -10.0


class Places(NamedTuple):
    """The positions of a tree's nodes in a complete tree, counted level by level."""

    split: Int[np.ndarray, " inner"]
    """The tree's node at each split; −1 where a split only fills up."""
    leaf: Int[np.ndarray, " leaves"]
    """The tree's leaf that answers at each leaf."""


def places(tree: DecisionTree, depth: int) -> Places:
    """Lay a tree out in a complete one.

    Args:
        tree: The tree.
        depth: The depth of the complete tree.

    Returns:
        The positions of its nodes.

    Raises:
        ValueError: The tree is deeper, or no complete tree is so deep.
    """
    if not 1 <= depth <= MAX_DEPTH:
        raise ValueError(f"depth must be between 1 and {MAX_DEPTH}, got {depth}")
    if tree.depth > depth:
        raise ValueError(
            f"the tree has depth {tree.depth} and does not fit into depth {depth}; choose --depth {tree.depth} "
            f"(depth={tree.depth} in Python), or prune it"
        )
    node = np.zeros(1, np.int64)
    split: list[np.ndarray] = []
    for _ in range(depth):
        leaf = tree.is_leaf[node]
        split.append(np.where(leaf, -1, node))
        children = np.stack([tree.children_left[node], tree.children_right[node]], axis=1)
        node = np.where(leaf[:, None], node[:, None], children).ravel()
    return Places(np.concatenate(split), node)


def embed(
    tree: DecisionTree,
    *,
    depth: int,
    rng: np.random.Generator,
    confidence: float = 0.7,
    kept_leaves: Bool[np.ndarray, " nodes"] | None = None,
    log_std: float = 0.0,
    surrogate: Surrogate = "sigmoid",
    temperature: float = 1.0,
) -> Tree:
    """The complete tree that acts, on every float32 observation, as ``tree`` does; it sees raw observations.

    Args:
        tree: of any shape, at most ``depth`` deep.
        depth: of the complete tree.
        rng: draws the logits of the features that are not chosen, so that no two of them are alike.
        confidence: how probable a leaf's action becomes where the leaf is all but sure of it: see `leaf_logits`.
        kept_leaves: leaves of the tree whose values are taken as they are, whatever ``confidence`` is.
        log_std: where the actions are continuous and the tree has no standard deviation.
        surrogate: see `Tree`.
        temperature: see `Tree`.

    Raises:
        ValueError: if the tree is too deep, or the confidence is none.
    """
    where = places(tree, depth)
    kept = where.split >= 0
    logits = 0.1 * rng.standard_normal((kept.size, tree.n_features))
    thresholds = np.zeros((kept.size, tree.n_features), np.float32)
    at, feature = np.flatnonzero(kept), tree.feature[where.split[kept]]
    logits[at, feature] = logits[at].max(axis=1) + MARGIN
    thresholds[at, feature] = tree.threshold[where.split[kept]]
    value = leaf_logits(tree, confidence)
    if kept_leaves is not None:
        value = np.where(kept_leaves[:, None], tree.leaf_outputs, value)
    return Tree(
        feature_logits=jnp.asarray(logits, jnp.float32),
        thresholds=jnp.asarray(thresholds),
        leaf_values=jnp.asarray(value[where.leaf]),
        log_std=jnp.asarray(_log_std(tree, log_std)),
        surrogate=surrogate,
        temperature=temperature,
    )


def leaf_logits(tree: DecisionTree, confidence: float) -> Float32[np.ndarray, "nodes outputs"]:
    """The values of a tree's nodes as a policy that can learn; the deterministic action stays what it is.

    Logits stay as they are, unless they are hard: only zeros and a single one (an action by its number, a class of
    scikit-learn), or an action of more than 99.9 %. A hard leaf gives its action the probability ``confidence`` and
    shares the rest among the others. With a confidence of 1, all stay as they are. So do means of continuous actions.

    Raises:
        ValueError: a confidence above 1, or so low that another action would be as probable.
    """
    actions = tree.actions
    if isinstance(actions, BoxActions):
        return tree.leaf_outputs
    sizes = (actions.n,) if isinstance(actions, DiscreteActions) else actions.nvec
    least = 1 / min((size for size in sizes if size > 1), default=math.inf)
    if not least < confidence <= 1:
        raise ValueError(
            f"confidence must be above {least:.3g}, or another action would be as probable, and at most 1, got "
            f"{confidence}"
        )
    if confidence == 1:
        return tree.leaf_outputs
    parts = np.split(tree.leaf_outputs, np.cumsum(sizes)[:-1], axis=1)
    return np.concatenate([_softened(part, confidence) for part in parts], axis=1)


def _softened(logits: Float32[np.ndarray, "nodes n"], confidence: float) -> Float32[np.ndarray, "nodes n"]:
    """Of one choice among n."""
    n = logits.shape[1]
    if n == 1:
        return logits
    chosen = np.argmax(logits, axis=1)[:, None]  # of equal ones the first, as in acting
    is_chosen = np.arange(n)[None] == chosen
    weights = np.exp(logits.astype(np.float64) - logits.max(axis=1, keepdims=True))
    certain = weights.sum(axis=1) < 1 / CERTAIN
    one_hot = (logits == is_chosen).all(axis=1)
    soft = np.where(is_chosen, math.log(confidence), math.log((1 - confidence) / (n - 1)))
    return np.where((certain | one_hot)[:, None], soft, logits).astype(np.float32)


def _log_std(tree: DecisionTree, default: float) -> Float[np.ndarray, " num_std"]:
    """The tree's own where it has one that is above zero; a policy without noise could not learn."""
    if not isinstance(tree.actions, BoxActions):
        return np.zeros(0, np.float32)
    std = np.array(tree.actions.std or (0.0,) * tree.actions.n_outputs)
    with np.errstate(divide="ignore"):
        own = np.maximum(np.log(std), LEAST_LOG_STD)
    return flushed(np.where(std > 0, own, default))
