"""Initialization from data: the first chunk of experience places the thresholds of a tree.

`init_from_tree` is for a training that starts from a tree, which acts on raw observations until then. The scale of the
features must not move an observation across a threshold of that tree, not even the float next to it. So scales are
powers of two here, which round nothing, and shifts are multiples of them. Where a threshold and the float above it
would still become equal (a shift rounds, and small numbers underflow), the feature has no shift, or no scale either.

`init_thresholds` is for a training that starts at random with ``threshold_init="visited"``.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int, PRNGKeyArray

from ..functional import select
from ..policies.tree import MASKED, Tree
from ..types import Transition
from .normalization import refit_normalizer
from .state import Normalizer, TrainState

LARGEST_EXPONENT = 126
"""The largest exponent of a scale; a feature with a larger spread keeps some of it."""

_SMALLEST_NORMAL = float(np.finfo(np.float32).smallest_normal)


def init_from_tree(
    scaling: tuple[Normalizer, np.ndarray], state: TrainState, rollout: Transition, key: PRNGKeyArray
) -> TrainState:
    """Scale the features exactly, and place the thresholds of padding splits among the observations.

    Args:
        scaling: What `initial_normalizer` returned.
        state: The state of a training that starts from a tree and has a raw normalizer.
        rollout: The first rollout, unscaled.
        key: The key to draw the observations with.

    Returns:
        The state. Its tree acts as before on every observation.
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
    thresholds = jnp.where(actor.thresholds >= MASKED, MASKED, thresholds)  # closed nodes stay closed
    if state.guide is not None:  # the critic was trained on another scale
        critic: Any = state.networks.critic
        state = state._replace(
            networks=state.networks._replace(critic=critic.on_scale(state.guide.scale, normalizer))
        )
    return _with_thresholds(state, normalizer, thresholds)


def init_thresholds(
    scaling: tuple[Normalizer, np.ndarray], state: TrainState, rollout: Transition, key: PRNGKeyArray
) -> TrainState:
    """Scale the features, and place all thresholds among the observations. Nodes keep the features they test.

    Args:
        scaling: What `initial_normalizer` returned.
        state: The state of a new training.
        rollout: The first rollout, scaled by ``scaling``.
        key: The key to draw the observations with.

    Returns:
        The state with another normalizer and other thresholds.
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
    initialized = Tree(
        actor.feature_logits,
        thresholds,
        actor.leaf_values,
        actor.log_std,
        actor.surrogate,
        actor.temperature,
    )
    return state._replace(
        networks=state.networks._replace(actor=initialized),
        normalizer=normalizer,
        validation=state.validation._replace(best_actor=initialized),
    )


def exact_normalizer(
    wanted: Normalizer,
    feature: Int[Array, " nodes"],
    threshold: Float[Array, " nodes"],
    kept: Bool[Array, " nodes"],
) -> Normalizer:
    """Return the normalizer nearest to ``wanted`` that keeps every float32 on its side of the thresholds of kept nodes.

    As rounding never changes an order, it is enough that a threshold and the float above it stay different.
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
    """Scale one number of the feature of each node."""
    return (raw - normalizer.shift[feature]) * normalizer.scale[feature]


def next_float(x: Float[Array, " n"]) -> Float[Array, " n"]:
    """Return the next larger float32, where subnormal numbers count as zero."""
    up = jnp.nextafter(x, jnp.full_like(x, jnp.inf))
    return jnp.where(x == 0, _SMALLEST_NORMAL, jnp.where(jnp.abs(up) < _SMALLEST_NORMAL, 0.0, up))


def thresholds_among(
    x: Float[Array, "batch features"],
    feature: Int[Array, " nodes"],
    threshold: Float[Array, " nodes"],
    kept: Bool[Array, " nodes"],
    key: PRNGKeyArray,
) -> Float[Array, "nodes features"]:
    """Draw a threshold for each node and feature, halfway between two random observations that reach the node.

    Args:
        x: Scaled observations.
        feature: The feature that each node tests.
        threshold: The threshold of each node.
        kept: The nodes that keep their threshold for the feature they test.
        key: The key to draw the observations with.

    Returns:
        The thresholds. A node that no observation reaches has one halfway between any two.
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
    """Return 2^exponent, exact to the bit, which ``exp2`` does not promise."""
    bits = (exponent.astype(jnp.int32) + 127) << 23
    return jax.lax.bitcast_convert_type(bits, jnp.float32)
