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

from .entmax import entmax15_vjp

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
    """The feature each node looks at, and its threshold: what acting needs, once for a whole rollout."""
    num_nodes, num_features = feature_logits.shape
    # argmax, written so that XLA vectorises it (three times faster for 147 features)
    candidate = jnp.arange(num_features, dtype=jnp.int32)[None]
    best = feature_logits == jnp.max(feature_logits, axis=1, keepdims=True)
    feature = jnp.min(jnp.where(best, candidate, num_features - 1), axis=1)
    at = jnp.arange(num_nodes, dtype=jnp.uint32) * num_features + feature.astype(jnp.uint32)
    return feature, _flush(_take(thresholds.reshape(-1), at))


def leaf_index(
    feature: Int[Array, " N"], threshold: Float[Array, " N"], x: Float[Array, "B F"]
) -> Int[Array, " B"]:
    """The leaf (0 to L − 1) each observation falls into: D comparisons, no gradient.

    ``feature`` and ``threshold`` are those of `select`; ``leaf_values[leaf_index(...)]`` is then `hard_tree`.

    Raises:
        ValueError: if the number of nodes is not that of a full tree.
    """
    depth = _depth(feature.shape[0])
    node = jnp.zeros(x.shape[0], jnp.uint32)
    node = jax.lax.fori_loop(0, depth, lambda _, node: _child(feature, threshold, x, node), node)
    return node.astype(jnp.int32) - feature.shape[0]


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _hard_tree(
    surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array
) -> Array:
    return _forward(surrogate, feature_logits, thresholds, leaf_values, x)[0]


def _forward(surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array):
    feature, threshold = select(feature_logits, thresholds)
    leaf = leaf_index(feature, threshold, x).astype(jnp.uint32)
    return _take(leaf_values, leaf), (feature_logits, thresholds, leaf_values, x, feature, threshold, leaf)


def _backward(surrogate: Surrogate, residuals: tuple[Array, ...], g: Array):
    """What each observation adds, at the D nodes of its own path; everything else is zero.

    With u = g · leaf_values[own leaf] and v the same for the leaf it would have reached from the child not
    taken at a node, ∂loss/∂s there is ±(u − v).
    """
    feature_logits, thresholds, leaf_values, x, feature, threshold, leaf = residuals
    num_nodes, num_features = feature_logits.shape
    depth = _depth(num_nodes)

    # The path [D, B]. Counting nodes from one, a parent is half its child, the root at level 0.
    level = jnp.arange(depth, dtype=jnp.uint32)[:, None]
    child = ((leaf[None] + (num_nodes + 1)) >> (depth - 1 - level)) - 1
    path = (child - 1) >> 1
    went_left = child & 1 == 1
    sibling = jnp.where(went_left, child + 1, child - 1)

    # All siblings descend to a leaf together, the one of the next level joining after each step.
    walk = sibling[:1]
    for d in range(1, depth):
        walk = jnp.concatenate([_child(feature, threshold, x, walk), sibling[d : d + 1]])

    own = jnp.sum(g * _take(leaf_values, leaf), axis=1)[None]
    other = jnp.einsum("dba,ba->db", _take(leaf_values, walk - num_nodes), g, precision=Precision.HIGHEST)
    delta = jnp.where(went_left, own - other, other - own)
    c = delta * _slope(surrogate, _take(threshold, path) - _value(feature, x, path))

    total, product = _sum_at_nodes(c, path, x)
    thresholds = jnp.where(jnp.isfinite(thresholds), thresholds, 0.0)
    chosen = feature[:, None] == jnp.arange(num_features, dtype=jnp.int32)[None]
    return (
        entmax15_vjp(feature_logits, total[:, None] * thresholds - product),
        jnp.where(chosen, total[:, None], 0.0),
        jnp.zeros_like(leaf_values).at[leaf].add(g, mode="promise_in_bounds"),
        jnp.zeros_like(x),
    )


def _sum_at_nodes(c: Array, path: Array, x: Array) -> tuple[Array, Array]:
    """Σ_b c and Σ_b c·x at every node ([N] and [N, F]) from c [D, B] at the nodes of the paths [D, B].

    XLA scatters on a CPU row by row, so the levels near the root, which every observation shares with many,
    go in one row an observation, addressed by the node where they end; their tables are then summed upwards.
    """
    depth, batch = c.shape
    x = jnp.where(jnp.isfinite(x), x, 0.0)
    x = jnp.concatenate([x, jnp.ones_like(x[:, :1])], axis=1)
    width = x.shape[1]
    top = min(depth, 5 if width <= 32 else 3)

    rows = (c[:top].T[:, :, None] * x[:, None]).reshape(batch, top * width)
    table = jnp.zeros((2 ** (top - 1), top * width), x.dtype)
    table = table.at[path[top - 1] - (2 ** (top - 1) - 1)].add(rows, mode="promise_in_bounds")
    table = table.reshape(-1, top, width)
    sums = [table[:, d].reshape(2**d, -1, width).sum(1) for d in range(top)]
    if top < depth:
        low = jnp.zeros((2**depth - 2**top, width), x.dtype)
        rows = c[top:, :, None] * x[None]
        sums.append(low.at[path[top:] - (2**top - 1)].add(rows, mode="promise_in_bounds"))
    sums = jnp.concatenate(sums)
    return sums[:, -1], sums[:, :-1]


_hard_tree.defvjp(_forward, _backward)


def _slope(surrogate: Surrogate, difference: Array) -> Array:
    """S′, the derivative of the surrogate; nothing where the difference is not a number."""
    if surrogate == "sigmoid":
        e = jnp.exp(-jnp.abs(difference))
        slope = e / jnp.square(1.0 + e)
    else:
        slope = 0.5 / jnp.square(1.0 + jnp.abs(difference))
    return jnp.where(jnp.isnan(slope), 0.0, slope)


def _flush(values: Array) -> Array:
    """Denormals to zero, as XLA's arithmetic has them on a CPU but not on a GPU."""
    return jnp.where(jnp.abs(values) < _SMALLEST_NORMAL, 0.0, values)


def _take(table: Array, index: Array) -> Array:
    """table[index]; the index unsigned, or XLA spends as long on wrapping negative ones as on the gather."""
    return table.at[index].get(mode="promise_in_bounds")


def _value(feature: Array, x: Array, node: Array) -> Array:
    """x[b, feature[node[..., b]]] for nodes [..., B]."""
    batch, num_features = x.shape
    row = jnp.arange(batch, dtype=jnp.uint32) * num_features
    return _flush(
        _take(
            x.reshape(-1),
            row.reshape(*[1] * (node.ndim - 1), batch) + _take(feature.astype(jnp.uint32), node),
        )
    )


def _child(feature: Array, threshold: Array, x: Array, node: Array) -> Array:
    """Where the observations that are at these nodes [..., B] go next."""
    left = _value(feature, x, node) <= _take(threshold, node)
    return 2 * node + jnp.where(left, 1, 2).astype(jnp.uint32)


def _depth(num_nodes: int) -> int:
    depth = (num_nodes + 1).bit_length() - 1
    if num_nodes != 2**depth - 1 or not 1 <= depth <= MAX_DEPTH:
        raise ValueError(
            f"a full tree of depth 1 to {MAX_DEPTH} has 2^depth − 1 inner nodes, got {num_nodes}; "
            "pad the tree to a full one"
        )
    return depth


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
