"""Before the first step: the random streams of a training, and its networks."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import jax
import numpy as np
from jax import Array
from jaxtyping import Int, PRNGKeyArray

from ..policies.action_units import add_to_outputs
from ..policies.distributions import DiagonalGaussian, Distribution
from ..policies.mlp import MLPActor
from ..policies.soft_tree import SoftTree
from ..policies.tree import Tree
from .config import Config, Hyperparameters
from .split_growth import closed
from .state import Networks

Purpose: TypeAlias = Literal["init", "train", "validation"]
PURPOSES: tuple[Purpose, ...] = ("init", "train", "validation")


def purpose_key(seed: Int[Array, ""], purpose: Purpose) -> PRNGKeyArray:
    """Return the JAX key of one purpose in the training with this seed; different purposes never share a stream."""
    return jax.random.fold_in(jax.random.key(seed), PURPOSES.index(purpose))


def host_seed(seed: int, purpose: Purpose, timestep: int = 0) -> int:
    """Return a seed for environments on the host.

    Args:
        seed: The seed of the training.
        purpose: What the episodes are for.
        timestep: The environment steps at which they begin.

    Returns:
        An integer below 2^63; no two purposes, seeds or timesteps share one, up to chance.
    """
    words = np.random.SeedSequence([seed, PURPOSES.index(purpose), timestep]).generate_state(1, np.uint64)
    return int(words[0] >> np.uint64(1))


def init_networks(
    config: Config,
    distribution: Distribution,
    num_features: int,
    hyper: Hyperparameters,
    key: PRNGKeyArray,
) -> Networks:
    """Create an actor and a state-value critic with random parameters.

    Args:
        config: Their kinds and sizes.
        distribution: The distribution that the actor parametrizes.
        num_features: The number of features of an observation.
        hyper: The traced hyperparameters.
        key: The key to draw the parameters with.

    Returns:
        The networks.
    """
    actor_key, critic_key = jax.random.split(key)
    outputs = {"num_outputs": distribution.num_outputs, "num_std": distribution.num_std}
    actor = _network(
        config.policy,
        config,
        num_features,
        hyper,
        actor_key,
        hidden=config.actor_hidden,
        log_std=hyper.log_std_init,
        **outputs,
    )
    if isinstance(distribution, DiagonalGaussian):
        actor = add_to_outputs(actor, np.asarray(distribution.centers, np.float32))
    if config.grow_splits and isinstance(actor, Tree):
        actor = closed(actor)
    critic = _network(config.critic, config, num_features, hyper, critic_key, hidden=config.critic_hidden)
    return Networks(actor, critic.net if isinstance(critic, MLPActor) else critic)


def _network(
    kind: str,
    config: Config,
    num_features: int,
    hyper: Hyperparameters,
    key: PRNGKeyArray,
    *,
    hidden: tuple[int, ...],
    num_outputs: int = 1,
    num_std: int = 0,
    log_std: Any = 0.0,
) -> Any:
    std = {"num_std": num_std, "log_std": log_std}
    if kind == "mlp":
        return MLPActor.create(key, (num_features, *hidden, num_outputs), **std)
    size = {"depth": config.depth, "num_features": num_features, "num_outputs": num_outputs}
    if kind == "sdt":
        return SoftTree.create(key, temperature=config.temperature, **size, **std)
    return Tree.create(
        key,
        surrogate=config.surrogate,
        temperature=config.temperature,
        threshold_std=hyper.threshold_std_init,
        **size,
        **std,
    )
