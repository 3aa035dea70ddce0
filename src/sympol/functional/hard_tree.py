"""A hard, axis-aligned decision tree as a differentiable function: exact, without the textbook's product.

Forward it is an ordinary tree. Backward it is straight-through: each hard comparison stands in for a sigmoid,
each hard choice of a feature for entmax15. Autodiff of the textbook form multiplies D factors for every leaf;
here only what an observation met on its way contributes, so only that is computed (docs/hard_tree.md).

    D depth (1 to 14)   N = 2^D − 1 inner nodes   L = 2^D leaves   F features   A action values   B batch

Node n has the children 2n + 1 (left) and 2n + 2 (right); leaf l is node N + l.
"""

from __future__ import annotations

from functools import partial
from typing import Literal, TypeAlias, get_args

import jax
import jax.numpy as jnp
from jax import Array
from jax.lax import Precision
from jaxtyping import Float, Int

from .entmax import entmax15_product, entmax15_root

Surrogate: TypeAlias = Literal["sigmoid", "softsign"]

MAX_DEPTH = 14
_SMALLEST_NORMAL = float(jnp.finfo(jnp.float32).tiny)


def hard_tree(
    feature_logits: Float[Array, "N F"],
    thresholds: Float[Array, "N F"],
    leaf_values: Float[Array, "L A"],
    x: Float[Array, "B F"],
    *,
    surrogate: Surrogate = "sigmoid",
) -> Float[Array, "B A"]:
    """Evaluate a hard decision tree, differentiable in its three parameters.

    Node n looks at feature j = argmax feature_logits[n] (the lowest index wins a tie) and sends an observation
    left where x[j] ≤ thresholds[n, j], right otherwise, NaN included. Denormals count as zero.

    The gradient is the exact straight-through gradient: the comparison is differentiated as
    S(thresholds[n, j] − x[j]), the choice of j as entmax15(feature_logits[n]). Entries of ``x`` that are NaN or
    infinite contribute nothing to it, so one bad observation does not poison the others.
    ``x`` itself has no gradient (it is zero).

    Args:
        feature_logits: which feature a node looks at.
        thresholds: one threshold for each node and feature.
        leaf_values: what a leaf answers: logits, or means.
        x: the observations.
        surrogate: S, the logistic function or (softsign + 1)/2.

    Raises:
        ValueError: if shapes, dtypes or the surrogate do not fit.
    """
    _check(feature_logits, thresholds, leaf_values, x, surrogate)
    return _hard_tree(surrogate, feature_logits, thresholds, leaf_values, x)


def select(
    feature_logits: Float[Array, "N F"], thresholds: Float[Array, "N F"]
) -> tuple[Int[Array, " N"], Float[Array, " N"]]:
    """The feature each node looks at and its threshold: once for all observations of a rollout."""
    feature = jnp.argmax(feature_logits, axis=1).astype(jnp.int32)
    return feature, _flush(jnp.take_along_axis(thresholds, feature[:, None], axis=1)[:, 0])


def leaf_index(
    feature: Int[Array, " N"], threshold: Float[Array, " N"], x: Float[Array, "B F"]
) -> Int[Array, " B"]:
    """The leaf (0 to L − 1) of each observation, by D comparisons; no gradient."""
    depth = _depth(feature.shape[0])
    node = jnp.zeros(x.shape[0], jnp.int32)
    for _ in range(depth):
        _, node = _descend(feature, threshold, x, node)
    return node - feature.shape[0]


def _descend(feature: Array, threshold: Array, x: Array, node: Array) -> tuple[Array, Array]:
    """One level down from ``node`` [B, ...]: the difference threshold − x there, and the child taken."""
    rows = jnp.arange(x.shape[0]).reshape(-1, *[1] * (node.ndim - 1))
    value = _flush(x.at[rows, feature[node]].get(mode="promise_in_bounds"))
    at = threshold.at[node].get(mode="promise_in_bounds")
    return at - value, 2 * node + jnp.where(value <= at, 1, 2)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _hard_tree(
    surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array
) -> Array:
    return leaf_values[leaf_index(*select(feature_logits, thresholds), x)]


def _forward(surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array):
    feature, threshold = select(feature_logits, thresholds)
    leaf = leaf_index(feature, threshold, x)
    return leaf_values[leaf], (feature_logits, thresholds, leaf_values, x, feature, threshold, leaf)


def _backward(surrogate: Surrogate, residuals: tuple[Array, ...], g: Array):
    feature_logits, thresholds, leaf_values, x, feature, threshold, leaf = residuals
    num_nodes, depth = feature.shape[0], _depth(feature.shape[0])

    own = jnp.sum(g * leaf_values[leaf], axis=1)
    ones = jnp.ones((1, depth), jnp.int32)
    level = jnp.arange(depth, dtype=jnp.int32)[None]
    path = ((leaf[:, None] + num_nodes + 1 * ones) >> (depth - level)) - 1
    difference, taken = _descend(feature, threshold, x, path)
    went_left = taken == 2 * path + 1

    # All siblings of the path walk down together, the one at depth d + 1 starting when its turn comes.
    walk = jnp.where(went_left, 2 * path + 2, 2 * path + 1)
    for d in range(1, depth):
        _, below = _descend(feature, threshold, x, walk[:, :d])
        walk = jnp.concatenate([below, walk[:, d:]], axis=1)
    other = jnp.einsum("ba,bda->bd", g, leaf_values[walk - num_nodes], precision=Precision.HIGHEST)

    delta = jnp.where(went_left, 1.0, -1.0) * (own[:, None] - other)
    c = delta * _slope(surrogate, difference)
    finite_x = jnp.where(jnp.isfinite(x), x, 0.0)
    rows = c[:, :, None] * jnp.concatenate([finite_x, jnp.ones_like(x[:, :1])], axis=1)[:, None, :]
    sums = jnp.zeros((num_nodes, x.shape[1] + 1), x.dtype).at[path].add(rows)
    product, total = sums[:, :-1], sums[:, -1:]

    chosen = feature[:, None] == jnp.arange(x.shape[1], dtype=jnp.int32)[None]
    return (
        entmax15_product(entmax15_root(feature_logits), total * thresholds - product),
        jnp.where(chosen, total, 0.0),
        jnp.zeros_like(leaf_values).at[leaf].add(g),
        jnp.zeros_like(x),
    )


_hard_tree.defvjp(_forward, _backward)


def _slope(surrogate: Surrogate, difference: Array) -> Array:
    """S′, the derivative of the surrogate; nothing where the difference is not a number."""
    if surrogate == "sigmoid":
        s = jax.nn.sigmoid(difference)
        slope = s * (1.0 - s)
    else:
        slope = 0.5 / jnp.square(1.0 + jnp.abs(difference))
    return jnp.where(jnp.isnan(slope), 0.0, slope)


def _flush(values: Array) -> Array:
    """Denormals to zero, as XLA's arithmetic has them on a CPU but not on a GPU."""
    return jnp.where(jnp.abs(values) < _SMALLEST_NORMAL, 0.0, values)


def _depth(num_nodes: int) -> int:
    return (num_nodes + 1).bit_length() - 1


def _check(feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array, surrogate: str) -> None:
    """Raise a ValueError that names the value, the rule and the remedy."""
    for name, array in dict(
        feature_logits=feature_logits, thresholds=thresholds, leaf_values=leaf_values, x=x
    ).items():
        if array.ndim != 2:
            raise ValueError(
                f"{name} must have 2 axes, got shape {array.shape}; map further axes with jax.vmap"
            )
        if array.dtype != jnp.float32:
            raise ValueError(f"{name} must be float32, got {array.dtype}; convert it with .astype('float32')")
    num_leaves = leaf_values.shape[0]
    depth = num_leaves.bit_length() - 1
    if num_leaves < 1 or num_leaves != 2**depth:
        raise ValueError(
            f"leaf_values must have 2^depth rows, one for each leaf, got {num_leaves}; pad the tree to a full one"
        )
    if not 1 <= depth <= MAX_DEPTH:
        raise ValueError(
            f"depth must be between 1 and {MAX_DEPTH}, got {depth} (leaf_values has {num_leaves} rows); "
            "grow a deeper tree from several of these"
        )
    if x.shape[1] < 1:
        raise ValueError(f"x must have at least one feature, got shape {x.shape}")
    expected = (num_leaves - 1, x.shape[1])
    for name, array in dict(feature_logits=feature_logits, thresholds=thresholds).items():
        if array.shape != expected:
            raise ValueError(
                f"{name} must have shape {expected} (2^depth − 1 inner nodes for {num_leaves} leaves, "
                f"the {x.shape[1]} features of x), got {array.shape}"
            )
    if surrogate not in get_args(Surrogate):
        raise ValueError(f"surrogate must be one of {', '.join(get_args(Surrogate))}, got {surrogate!r}")
