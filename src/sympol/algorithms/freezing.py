"""What does not learn: frozen parts of a tree that training started from, and the actor while its critic warms up."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Bool, Float

from ..policies.tree import Tree
from .config import Config, Hyperparameters
from .optimizer import Networks, apply_gradients
from .state import TrainState


def warming_up(config: Config, state: TrainState) -> Bool[Array, ""]:
    """Whether only the critic learns, now."""
    if state.warm is None:
        return jnp.bool_(False)
    return state.timestep.astype(jnp.float32) < state.warm.critic_warmup * config.total_timesteps


def held(config: Config, state: TrainState) -> Networks | None:
    """Which parameters stay as they are, now: a mask for each of them; None where there is no such thing."""
    if state.warm is None:
        return None
    actor: Any = state.networks.actor
    waits = warming_up(config, state)
    splits = (state.warm.frozen_splits | waits)[:, None]
    leaves = (state.warm.frozen_leaves | waits)[:, None]
    mask: Any = Tree(splits, splits, leaves, waits, actor.surrogate, actor.temperature)
    return Networks(mask, jax.tree.map(lambda _: jnp.bool_(False), state.networks.critic))


def apply_gradients_but(
    still: Networks | None,
    networks: Networks,
    gradient: Networks,
    opt_state: optax.OptState,
    hyper: Hyperparameters,
    factor: Float[Array, ""],
) -> tuple[Networks, optax.OptState]:
    """`apply_gradients`, after which what is held is what it was, to the bit.

    Its gradient counts for nothing, neither in the norm that is clipped nor in Adam's moments.
    """
    if still is None:
        return apply_gradients(networks, gradient, opt_state, hyper, factor)
    gradient = _where(still, jax.tree.map(jnp.zeros_like, gradient), gradient)
    updated, opt_state = apply_gradients(networks, gradient, opt_state, hyper, factor)
    return _where(still, networks, updated), opt_state


def _where(mask: Networks, held: Networks, free: Networks) -> Networks:
    return jax.tree.map(jnp.where, mask, held, free)
