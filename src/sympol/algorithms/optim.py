"""AdamW with a learning rate for each group of parameters, some of which may be frozen."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Bool, Float

from ..policies.tree import Tree
from .config import Config, Hyperparameters
from .state import Networks, TrainState

ADAM_EPS = 1e-5
LOG_STD_BOUNDS = (-20.0, 2.0)
"""Usual bounds of the log standard deviation, up to a standard deviation of about 7."""
DECAYED = ("feature_logits", "leaf_values", "actor")
"""The groups with weight decay, which keeps choices of features and actions revisable. The size of a threshold means
nothing, so it has none."""


def labels(networks: Networks) -> Networks:
    """Return the group of each parameter, which names its learning rate.

    Returns:
        A pytree of strings: "critic"; for a tree that acts, the names of its fields; for other actors "log_std" or
        "actor".
    """
    is_tree = isinstance(networks.actor, Tree)

    def of_actor(path: Any, _: Array) -> str:
        name = getattr(path[-1], "name", "")
        return name if is_tree or name == "log_std" else "actor"

    actor = jax.tree_util.tree_map_with_path(of_actor, networks.actor)
    return Networks(actor, jax.tree.map(lambda _: "critic", networks.critic))


def optimizer(
    hyper: Hyperparameters, factor: Float[Array, ""], networks: Networks
) -> optax.GradientTransformation:
    """Make the update rule.

    Args:
        hyper: The traced hyperparameters; they may be tracers.
        factor: Scales every learning rate.
        networks: The parameters, for their groups.

    Returns:
        The transformation of gradients into updates.
    """
    names = labels(networks)
    decayed = jax.tree.map(lambda name: name in DECAYED, names)
    rates = jax.tree.map(lambda name: -factor * getattr(hyper, f"learning_rate_{name}"), names)
    return optax.chain(
        optax.scale_by_adam(eps=ADAM_EPS),
        optax.add_decayed_weights(hyper.weight_decay, decayed),
        optax.stateless(lambda updates, _: jax.tree.map(jnp.multiply, updates, rates)),
    )


def clip_by_norm(gradient: Any, max_norm: Float[Array, ""]) -> Any:
    """Scale a gradient down to the norm ``max_norm`` if it is longer."""
    norm = jnp.sqrt(sum(jnp.sum(jnp.square(g)) for g in jax.tree.leaves(gradient)))
    scale = jnp.minimum(1.0, max_norm / jnp.maximum(norm, 1e-12))
    return jax.tree.map(lambda g: g * scale, gradient)


def apply_gradients(
    networks: Networks,
    gradient: Networks,
    opt_state: optax.OptState,
    hyper: Hyperparameters,
    factor: Float[Array, ""],
    mask: Networks | None = None,
) -> tuple[Networks, optax.OptState]:
    """Take one optimizer step.

    Args:
        networks: The parameters.
        gradient: Their gradient, of the same shape.
        opt_state: The state of the optimizer.
        hyper: The traced hyperparameters.
        factor: Scales every learning rate.
        mask: Parameters that are frozen, see `frozen`. They stay the same to the bit, and their gradient counts
            neither in the norm that is clipped nor in Adam's moments.

    Returns:
        The new parameters and the new state of the optimizer.
    """
    if mask is not None:
        gradient = jax.tree.map(lambda still, g: jnp.where(still, jnp.zeros_like(g), g), mask, gradient)
    parameters: Any = networks
    clipped: Any = Networks(*(clip_by_norm(part, hyper.max_grad_norm) for part in gradient))
    with jax.numpy_dtype_promotion("standard"):  # Optax raises floats to its integer count
        updates, opt_state = optimizer(hyper, factor, networks).update(clipped, opt_state, parameters)
    updated = _bounded(eqx.apply_updates(networks, updates))
    if mask is not None:
        updated = jax.tree.map(jnp.where, mask, networks, updated)
    return updated, opt_state


def _bounded(networks: Networks) -> Networks:
    """Clip log_std to its bounds: a large entropy bonus would raise it to infinity."""
    log_std = jnp.clip(networks.actor.log_std, *LOG_STD_BOUNDS)
    return networks._replace(actor=eqx.tree_at(lambda actor: actor.log_std, networks.actor, log_std))


def only_critic_learns(config: Config, state: TrainState) -> Bool[Array, ""]:
    """Return whether the critic is still warming up, during which the actor stays as it is."""
    if state.warm is None:
        return jnp.bool_(False)
    return state.timestep.astype(jnp.float32) < state.warm.critic_warmup * config.total_timesteps


def frozen(config: Config, state: TrainState) -> Networks | None:
    """Return which parameters are frozen now.

    Args:
        config: The configuration.
        state: The state of a training.

    Returns:
        A mask for each parameter, or None where the training did not start from a tree and nothing is ever frozen.
    """
    if state.warm is None:
        return None
    actor: Any = state.networks.actor
    waits = only_critic_learns(config, state)
    splits = (state.warm.frozen_splits | waits)[:, None]
    leaves = (state.warm.frozen_leaves | waits)[:, None]
    mask: Any = Tree(splits, splits, leaves, waits, actor.surrogate, actor.temperature)
    return Networks(mask, jax.tree.map(lambda _: jnp.bool_(False), state.networks.critic))
