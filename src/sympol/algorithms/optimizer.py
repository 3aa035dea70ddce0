"""AdamW with a learning rate for each group of parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Float

from ..policies.mlp import MLP
from ..policies.soft_tree import SoftTree
from ..policies.tree import Tree
from .config import Hyperparameters

ADAM_EPS = 1e-5
LOG_STD_BOUNDS = (-20.0, 2.0)
"""As is usual. No action space of ours is so wide that a deviation of 7 would not fill it."""
DECAYED = ("feature_logits", "leaf_values", "actor")
"""Weight decay keeps choices of features and actions revisable; the size of a tree's threshold means nothing."""


class Networks(NamedTuple):
    """What is trained: the policy and the value function, apart from each other."""

    actor: Any
    """An `Actor`."""
    critic: MLP | Tree | SoftTree


def labels(networks: Networks) -> Networks:
    """The group of each parameter: "critic"; in a tree that acts its field; in other actors "log_std" or "actor"."""
    is_tree = isinstance(networks.actor, Tree)

    def of_actor(path: Any, _: Array) -> str:
        name = getattr(path[-1], "name", "")
        return name if is_tree or name == "log_std" else "actor"

    actor = jax.tree_util.tree_map_with_path(of_actor, networks.actor)
    return Networks(actor, jax.tree.map(lambda _: "critic", networks.critic))


def optimizer(
    hyper: Hyperparameters, factor: Float[Array, ""], networks: Networks
) -> optax.GradientTransformation:
    """The update rule; ``factor`` scales every learning rate. The numbers may be traced."""
    names = labels(networks)
    decayed = jax.tree.map(lambda name: name in DECAYED, names)
    rates = jax.tree.map(lambda name: -factor * getattr(hyper, f"learning_rate_{name}"), names)
    return optax.chain(
        optax.scale_by_adam(eps=ADAM_EPS),
        optax.add_decayed_weights(hyper.weight_decay, decayed),
        optax.stateless(lambda updates, _: jax.tree.map(jnp.multiply, updates, rates)),
    )


def clip_by_norm(gradient: Any, max_norm: Float[Array, ""]) -> Any:
    """Scale a gradient down to ``max_norm`` if it is longer."""
    norm = jnp.sqrt(sum(jnp.sum(jnp.square(g)) for g in jax.tree.leaves(gradient)))
    scale = jnp.minimum(1.0, max_norm / jnp.maximum(norm, 1e-12))
    return jax.tree.map(lambda g: g * scale, gradient)


def apply_gradients(
    networks: Networks,
    gradient: Networks,
    opt_state: optax.OptState,
    hyper: Hyperparameters,
    factor: Float[Array, ""],
) -> tuple[Networks, optax.OptState]:
    """One optimiser step."""
    parameters: Any = networks
    clipped: Any = Networks(*(clip_by_norm(part, hyper.max_grad_norm) for part in gradient))
    with jax.numpy_dtype_promotion("standard"):  # Optax raises floats to its integer count
        updates, opt_state = optimizer(hyper, factor, networks).update(clipped, opt_state, parameters)
    return _bounded(eqx.apply_updates(networks, updates)), opt_state


def _bounded(networks: Networks) -> Networks:
    """The networks with log_std put back into its bounds: a large entropy bonus would raise it to infinity."""
    log_std = jnp.clip(networks.actor.log_std, *LOG_STD_BOUNDS)
    return networks._replace(actor=eqx.tree_at(lambda actor: actor.log_std, networks.actor, log_std))
