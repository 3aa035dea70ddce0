"""A hard, axis-aligned decision tree as a differentiable function: exact, without the textbook's product.

Forward it is an ordinary tree. Backward it is straight-through: each hard comparison stands in for a sigmoid,
each hard choice of a feature for entmax15. Autodiff of the textbook form multiplies D factors for every leaf,
O(B·L·D); here only what an observation met on its way is computed, O(B·D² + N·F), and nothing is approximated.

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
TOP_LEVELS = 4
"""Levels whose gradients are summed by a matrix product; 3 to 5 measure alike (studies/benchmarks/hard_tree.py)."""
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
        feature_logits: ``[N, F]``; the largest logit of a node chooses its feature.
        thresholds: ``[N, F]``; a threshold for each feature that a node may compare.
        leaf_values: ``[L, A]`` with L = N + 1; the logits or means of each leaf.
        x: Observations ``[B, F]``.
        surrogate: S, the logistic function (``"sigmoid"``) or (softsign + 1)/2 (``"softsign"``).

    Returns:
        Outputs ``[B, A]``.

    Raises:
        ValueError: if shapes, dtypes or the surrogate do not fit.
    """
    _check(feature_logits, thresholds, leaf_values, x, surrogate)
    return _hard_tree(surrogate, feature_logits, thresholds, leaf_values, x)


def select(
    feature_logits: Float[Array, "N F"], thresholds: Float[Array, "N F"]
) -> tuple[Int[Array, " N"], Float[Array, " N"]]:
    """Select the feature of each node and its threshold, once for a whole rollout.

    Args:
        feature_logits: As in `hard_tree`.
        thresholds: As in `hard_tree`.

    Returns:
        Features and thresholds, each ``[N]``.
    """
    num_nodes, num_features = feature_logits.shape
    # jnp.argmax, in the words that XLA vectorises (three times faster for 147 features)
    candidate = jnp.arange(num_features, dtype=jnp.int32)[None]
    best = feature_logits == jnp.max(feature_logits, axis=1, keepdims=True)
    feature = jnp.min(jnp.where(best, candidate, num_features - 1), axis=1)
    at = jnp.arange(num_nodes, dtype=jnp.uint32) * num_features + feature.astype(jnp.uint32)
    return feature, _flush(_take(thresholds.reshape(-1), at))


def leaf_index(
    feature: Int[Array, " N"], threshold: Float[Array, " N"], x: Float[Array, "B F"]
) -> Int[Array, " B"]:
    """Return the leaf that each observation reaches, after D comparisons; it has no gradient.

    ``leaf_values[leaf_index(...)]`` equals `hard_tree` to the bit.

    Args:
        feature: The features that `select` returned; one outside 0 to F − 1 is not checked.
        threshold: The thresholds that `select` returned.
        x: Observations ``[B, F]``.

    Returns:
        Leaves ``[B]``, from 0 to L − 1.

    Raises:
        ValueError: if the number of nodes is not that of a full tree.
    """
    num_nodes, root = feature.shape[0], jnp.zeros(x.shape[0], jnp.uint32)
    descend = partial(_descend, feature, threshold, x)
    leaf = jax.lax.fori_loop(0, _depth(num_nodes), lambda _, node: descend(node)[0], root) - num_nodes
    return leaf.astype(jnp.int32)


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _hard_tree(
    surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array
) -> Array:
    leaf = leaf_index(*select(feature_logits, thresholds), x)
    return _take(leaf_values, leaf.astype(jnp.uint32))


def _forward(surrogate: Surrogate, feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array):
    """The same, keeping threshold − x at each node of the path [D, B]."""
    feature, threshold = select(feature_logits, thresholds)
    num_nodes, root = feature.shape[0], jnp.zeros(x.shape[0], jnp.uint32)
    descend = partial(_descend, feature, threshold, x)
    node, difference = jax.lax.scan(lambda node, _: descend(node), root, length=_depth(num_nodes))
    leaf = node - num_nodes
    residuals = feature_logits, thresholds, leaf_values, x, feature, threshold, leaf, difference
    return _take(leaf_values, leaf), residuals


def _backward(surrogate: Surrogate, residuals: tuple[Array, ...], g: Array):
    """The straight-through gradient: an observation contributes at the D nodes of its own path, nowhere else.

    At such a node let s = S(threshold − x) be the weight of its left child. With u = g · leaf_values[own leaf]
    and v the same for the leaf reached from the child not taken, ∂loss/∂s is u − v if it went left, v − u if
    right, and c = ∂loss/∂s · S′. Summed over the batch, thresholds[n, j] gets Σc, the choice of feature f gets
    Σ c·(thresholds[n, f] − x[f]) (then the derivative of entmax15), a leaf the g of those that fell into it.
    """
    feature_logits, thresholds, leaf_values, x, feature, threshold, leaf, difference = residuals
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
        walk = jnp.concatenate([_descend(feature, threshold, x, walk)[0], sibling[d : d + 1]])

    own = jnp.sum(g * _take(leaf_values, leaf), axis=1)[None]
    other = jnp.einsum("dba,ba->db", _take(leaf_values, walk - num_nodes), g, precision=Precision.HIGHEST)
    delta = jnp.where(went_left, own - other, other - own)
    c = delta * _slope(surrogate, difference)

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

    The levels near the root, where every observation meets many others, go by a matrix product with the
    masked c; below, where a product would be mostly zeros, by a scatter (which runs row by row on a CPU).
    """
    depth, top = c.shape[0], min(c.shape[0], TOP_LEVELS)
    x = jnp.where(jnp.isfinite(x), x, 0.0)
    x = jnp.concatenate([x, jnp.ones_like(x[:, :1])], axis=1)

    def at_level(d: int) -> Array:
        node = jnp.arange(2**d - 1, 2 ** (d + 1) - 1, dtype=jnp.uint32)
        return jnp.where(node[:, None] == path[d][None], c[d][None], 0.0)

    masked = jnp.concatenate([at_level(d) for d in range(top)])
    sums = jnp.dot(masked, x, precision=Precision.HIGHEST)
    if top < depth:
        below = jnp.zeros((2**depth - 2**top, x.shape[1]), x.dtype)
        at = path[top:] - (2**top - 1)
        below = below.at[at].add(c[top:, :, None] * x[None], mode="promise_in_bounds")
        sums = jnp.concatenate([sums, below])
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


def _descend(feature: Array, threshold: Array, x: Array, node: Array) -> tuple[Array, Array]:
    """Where the observations at these nodes [..., B] go next, and threshold − x there."""
    batch, num_features = x.shape
    row = jnp.arange(batch, dtype=jnp.uint32) * num_features
    at = row.reshape(*[1] * (node.ndim - 1), batch) + _take(feature.astype(jnp.uint32), node)
    value = _flush(_take(x.reshape(-1), at))
    limit = _take(threshold, node)
    child = 2 * node + jnp.where(value <= limit, 1, 2).astype(jnp.uint32)
    return child, limit - value


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
            "use fewer leaves: as many again for each level make a tree that nobody reads"
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
