"""entmax15: between softmax and argmax, sparse and smooth (Peters, Niculae & Martins 2019, arXiv:1905.05702).

With z = (x − max x)/2 the value is p = (z − t)₊², where the threshold t solves Σ(z − t)₊² = 1.

The usual algorithm sorts. This one finds t by Newton's method on h(t) = ‖(z − t)₊‖ − 1, which is convex and
falls, so from t = −1 (where h ≥ 0: the largest entry alone contributes 1) every step stays left of the root
and none overshoots. The norm and not its square: with n equal entries the norm is a straight line and one step
lands on the root, while the square would halve its way there in log₂ √n steps.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

NEWTON_STEPS = 6
"""Number of steps after which float32 no longer changes, even for a thousand entries (ten entries need four)."""


def entmax15(logits: Float[Array, "*shape"], axis: int = -1) -> Float[Array, "*shape"]:
    """Map ``logits`` to a sparse distribution along ``axis``.

    Differentiable in forward and reverse mode by its closed derivative: with s = √p it is the symmetric matrix
    diag(s) − s sᵀ / Σs.

    Args:
        logits: Finite numbers, at least one along ``axis``.
        axis: The axis that sums to one.

    Returns:
        Probabilities of the same shape, some of them exactly zero.

    Raises:
        ValueError: The logits have no such axis, or nothing along it.
    """
    if not -logits.ndim <= axis < logits.ndim:
        raise ValueError(f"axis must exist in logits of shape {logits.shape}, got {axis}")
    if logits.shape[axis] == 0:
        raise ValueError(f"logits must have an entry along axis {axis}, got shape {logits.shape}")
    return _entmax15(axis % logits.ndim, logits)


def entmax15_vjp(logits: Float[Array, "rows n"], v: Float[Array, "rows n"]) -> Float[Array, "rows n"]:
    """Multiply the derivative of entmax15 along the last axis by a vector.

    Args:
        logits: Finite numbers.
        v: A vector for each row.

    Returns:
        The product for each row.
    """
    if logits.shape[1] > 32:
        return _product(_root(logits, 1), v, 1)
    # XLA's sums over a short last axis are slow; down the columns they are vectorised
    return _product(_root(logits.T, 0), v.T, 0).T


def entmoid15(z: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Compute the first of the two probabilities entmax15([z, 0]): a sigmoid that is 0 below −2 and 1 above 2.

    With a = z/2 the threshold of two entries solves (a − t)² + t² = 1, so p = ((a + √(2 − a²))/2)² for |a| < 1.

    Args:
        z: Numbers.

    Returns:
        Probabilities of the same shape.
    """
    a = jnp.clip(0.5 * z, -1.0, 1.0)
    return jnp.square(0.5 * (a + jnp.sqrt(2.0 - a * a)))


def _root(logits: Array, axis: int) -> Array:
    """Return √entmax15, from which the derivative follows."""
    half = logits * 0.5
    z = half - jnp.max(half, axis, keepdims=True)

    def newton(_: int, t: Array) -> Array:
        s = jnp.maximum(z - t, 0.0)
        square = jnp.sum(s * s, axis, keepdims=True)
        return t + (square - jnp.sqrt(square)) / jnp.sum(s, axis, keepdims=True)

    t = jnp.full_like(jnp.sum(z, axis, keepdims=True), -1.0)
    return jnp.maximum(z - jax.lax.fori_loop(0, NEWTON_STEPS, newton, t), 0.0)


def _product(root: Array, v: Array, axis: int) -> Array:
    mean = jnp.sum(root * v, axis, keepdims=True) / jnp.sum(root, axis, keepdims=True)
    return root * (v - mean)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _entmax15(axis: int, logits: Array) -> Array:
    return jnp.square(_root(logits, axis))


@_entmax15.defjvp
def _entmax15_jvp(axis: int, primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    root = _root(*primals, axis)
    return jnp.square(root), _product(root, *tangents, axis)
