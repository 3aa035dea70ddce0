"""The first chunk of a training that starts from a tree: features get a scale, and splits that only fill up a place.

(That of a training that starts at random is `spread`, if its splits are to begin where its observations are.)

Until then the tree acts on raw observations. A scale must not move an observation across a threshold of the tree, be it
the float beside it. So scales are powers of two here, which round nothing, and shifts are multiples of them; and where
a threshold and the float above it would still become one (a shift rounds, and small numbers underflow), the feature
goes without the shift, or without either.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from ..functional import select
from ..policies.tree import Tree
from ..types import Transition
from .init import refit_normalizer
from .state import Normalizer, TrainState

LARGEST_EXPONENT = 126
"""Of a scale: a feature whose spread is beyond that keeps some of it."""

_SMALLEST_NORMAL = float(np.finfo(np.float32).smallest_normal)


def settle(
    scaling: tuple[Normalizer, np.ndarray], state: TrainState, rollout: Transition, key: PRNGKeyArray
) -> TrainState:
    """Scale the features by the first chunk, exactly, and put the other thresholds where its observations are.

    ``scaling`` is what `normalizer_of` gives. The tree acts afterwards as it did before.
    """
    actor: Any = state.networks.actor
    assert isinstance(actor, Tree)
    assert state.warm is not None
    feature, threshold = select(actor.feature_logits, actor.thresholds)
    wanted = refit_normalizer(scaling[0], rollout, scaling[1])
    normalizer = exact_normalizer(wanted, feature, threshold, state.warm.kept)
    x = normalizer(rollout.observation[0].reshape(-1, actor.thresholds.shape[1]))
    threshold = normalize_at(normalizer, feature, threshold)
    thresholds = thresholds_among(x, feature, threshold, state.warm.kept, key)
    return _with_thresholds(state, normalizer, thresholds)


def spread(
    scaling: tuple[Normalizer, np.ndarray], state: TrainState, rollout: Transition, key: PRNGKeyArray
) -> TrainState:
    """Scale the features by the first chunk, and put all thresholds where its observations are.

    ``scaling`` is what `normalizer_of` gives, by which the rollout is scaled. Nodes keep the features they look at.
    """
    actor: Any = state.networks.actor
    assert isinstance(actor, Tree)
    normalizer = refit_normalizer(state.normalizer, rollout, scaling[1])
    x = rollout.observation[0].reshape(-1, actor.thresholds.shape[1])
    x = jnp.where(scaling[1], x, normalizer(x))
    feature, threshold = select(actor.feature_logits, actor.thresholds)
    kept = jnp.zeros(feature.shape, bool)
    return _with_thresholds(state, normalizer, thresholds_among(x, feature, threshold, kept, key))


def _with_thresholds(
    state: TrainState, normalizer: Normalizer, thresholds: Float[Array, "nodes features"]
) -> TrainState:
    actor: Any = state.networks.actor
    settled = Tree(
        actor.feature_logits,
        thresholds,
        actor.leaf_values,
        actor.log_std,
        actor.surrogate,
        actor.temperature,
    )
    return state._replace(
        networks=state.networks._replace(actor=settled),
        normalizer=normalizer,
        validation=state.validation._replace(best_actor=settled),
    )


def exact_normalizer(
    wanted: Normalizer,
    feature: Int[Array, " nodes"],
    threshold: Float[Array, " nodes"],
    kept: Bool[Array, " nodes"],
) -> Normalizer:
    """The nearest normalizer to ``wanted`` that keeps every float32 on its side of the thresholds of ``kept`` nodes.

    As rounding never changes an order, it is enough that a threshold and the float above it stay two numbers.
    """
    exponent = jnp.clip(jnp.round(jnp.log2(wanted.scale)), -LARGEST_EXPONENT, LARGEST_EXPONENT)
    scale, step = _power_of_two(exponent), _power_of_two(-exponent)
    shift = jnp.round(wanted.shift * scale) * step
    zero, one = jnp.zeros_like(shift), jnp.ones_like(scale)
    above = next_float(threshold)

    def keeps(candidate: Normalizer) -> Bool[Array, " features"]:
        low, high = (normalize_at(candidate, feature, raw) for raw in (threshold, above))
        good = ~kept | (jnp.isfinite(low) & (low < high))
        return jnp.isfinite(candidate.shift).at[feature].min(good)

    shifted, scaled = Normalizer(shift, scale), Normalizer(zero, scale)
    keeps_shifted, keeps_scaled = keeps(shifted), keeps(scaled)
    return Normalizer(
        jnp.where(keeps_shifted, shift, zero),
        jnp.where(keeps_shifted | keeps_scaled, scale, one),
    )


def normalize_at(
    normalizer: Normalizer, feature: Int[Array, " nodes"], raw: Float[Array, " nodes"]
) -> Float[Array, " nodes"]:
    """Numbers of these features, scaled."""
    return (raw - normalizer.shift[feature]) * normalizer.scale[feature]


def next_float(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """The next larger float32; those that are subnormal are one with zero."""
    up = jnp.nextafter(x, jnp.full_like(x, jnp.inf))
    return jnp.where(x == 0, _SMALLEST_NORMAL, jnp.where(jnp.abs(up) < _SMALLEST_NORMAL, 0.0, up))


def thresholds_among(
    x: Float[Array, "batch features"],
    feature: Int[Array, " nodes"],
    threshold: Float[Array, " nodes"],
    kept: Bool[Array, " nodes"],
    key: PRNGKeyArray,
) -> Float[Array, "nodes features"]:
    """A threshold for each node and feature, halfway between two random observations that come by the node.

    ``kept`` nodes have theirs already, for the feature that they look at. Where nobody comes by, any two
    observations will do.
    """
    num_nodes, batch = feature.shape[0], x.shape[0]
    order_key, any_key = jax.random.split(key)
    half = jnp.where(jnp.isfinite(x), 0.5 * x, 0.0)[jax.random.permutation(order_key, batch)]
    x = 2 * half
    row = jnp.arange(batch)
    some = half[jax.random.randint(any_key, (2, num_nodes), 0, batch)].sum(axis=0)
    looks_at = feature[:, None] == jnp.arange(x.shape[1], dtype=feature.dtype)[None]

    def placed(middle: Array) -> Array:
        return jnp.where(kept[:, None] & looks_at, threshold[:, None], middle)

    def level(_: Int[Array, ""], carry: tuple[Array, Array]) -> tuple[Array, Array]:
        node, thresholds = carry
        first = jnp.full(num_nodes, batch).at[node].min(row)
        last = jnp.full(num_nodes, -1).at[node].max(row)
        middle = half[jnp.minimum(first, batch - 1)] + half[jnp.maximum(last, 0)]
        thresholds = placed(jnp.where((last >= 0)[:, None], middle, thresholds))
        at = feature[node]
        left = x[row, at] <= thresholds[node, at]
        return 2 * node + jnp.where(left, 1, 2), thresholds

    depth = (num_nodes + 1).bit_length() - 1
    start = (jnp.zeros(batch, jnp.int32), placed(some))
    return jax.lax.fori_loop(0, depth, level, start)[1]


def _power_of_two(exponent: Float[Array, " n"]) -> Float[Array, " n"]:
    """2^exponent to the bit, which ``exp2`` does not promise."""
    bits = (exponent.astype(jnp.int32) + 127) << 23
    return jax.lax.bitcast_convert_type(bits, jnp.float32)
