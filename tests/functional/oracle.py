"""The textbook form of the tree: a product of D factors for each of the L leaves, differentiated by autodiff."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array


def entmax15_sorted(logits: Array) -> Array:
    """entmax15 along the last axis by sorting (Peters et al. 2019, algorithm 2)."""
    z = logits / 2
    z = z - z.max(-1, keepdims=True)
    ordered = jnp.flip(jnp.sort(z, axis=-1), axis=-1)
    k = jnp.arange(1, z.shape[-1] + 1, dtype=z.dtype).reshape(*[1] * (z.ndim - 1), -1)
    mean = jnp.cumsum(ordered, axis=-1) / k
    spread = jnp.cumsum(ordered**2, axis=-1) - k * mean**2
    room = (1 - spread) / k
    positive = room > 0
    thresholds = mean - jnp.where(positive, jnp.sqrt(jnp.where(positive, room, 1)), 0)
    support = jnp.sum(thresholds <= ordered, axis=-1, keepdims=True)
    return jnp.square(jnp.maximum(z - jnp.take_along_axis(thresholds, support - 1, axis=-1), 0))


def straight_through(hard: Array, soft: Array) -> Array:
    return soft + jax.lax.stop_gradient(hard - soft)


def textbook_tree(
    feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array, surrogate: str = "sigmoid"
) -> Array:
    """The hard tree as one soft formula, straight-through where it is hard."""
    num_leaves, num_features = leaf_values.shape[0], x.shape[1]
    depth = num_leaves.bit_length() - 1
    feature = feature_logits.argmax(1)
    choice = straight_through(
        jax.nn.one_hot(feature, num_features, dtype=x.dtype), entmax15_sorted(feature_logits)
    )
    difference = jnp.sum(choice * thresholds, axis=1)[None] - x @ choice.T
    soft = jax.nn.sigmoid(difference) if surrogate == "sigmoid" else (jax.nn.soft_sign(difference) + 1) / 2
    hard = x[:, feature] <= jnp.take_along_axis(thresholds, feature[:, None], 1)[:, 0][None]
    left = straight_through(hard.astype(x.dtype), soft)

    leaves = np.arange(num_leaves)[:, None] + num_leaves  # counting nodes from one, parents are halves
    levels = np.arange(depth)[None]
    nodes = (leaves >> (depth - levels)) - 1
    goes_right = (leaves >> (depth - levels - 1)) & 1
    factor = left[:, nodes]
    reach = jnp.prod(jnp.where(goes_right[None] == 1, 1 - factor, factor), axis=-1)
    return reach @ leaf_values


def plain_tree(
    feature_logits: np.ndarray, thresholds: np.ndarray, leaf_values: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """The tree as a person would walk it."""
    num_nodes = len(feature_logits)
    thresholds, x = flush(thresholds), flush(x)
    rows = []
    for observation in x:
        node = 0
        while node < num_nodes:
            feature = int(np.argmax(feature_logits[node]))
            node = 2 * node + (1 if observation[feature] <= thresholds[node, feature] else 2)
        rows.append(leaf_values[node - num_nodes])
    return np.stack(rows)


def flush(values: np.ndarray) -> np.ndarray:
    return np.where(np.abs(values) < np.finfo(np.float32).tiny, np.float32(0), values)


def random_tree(
    seed: int, depth: int, features: int, actions: int, batch: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """feature_logits, thresholds, leaf_values and observations, float32."""
    rng = np.random.default_rng(seed)
    nodes = 2**depth - 1
    shapes = [(nodes, features), (nodes, features), (nodes + 1, actions), (batch, features)]
    a, b, c, d = (rng.normal(size=shape).astype(np.float32) for shape in shapes)
    return a, b, c, d
