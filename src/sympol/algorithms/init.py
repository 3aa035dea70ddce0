"""Before the first step: keys, networks, the scale of the features."""

from __future__ import annotations

from typing import Any, Literal, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Int, PRNGKeyArray

from ..envs.spaces import LARGEST, UNBOUNDED
from ..functional.spread import center_and_scale
from ..policies.distributions import Distribution
from ..policies.mlp import MLPActor
from ..policies.soft_tree import SoftTree
from ..policies.tree import Tree
from ..types import Transition
from .config import Config, Hyperparameters
from .optimizer import Networks, optimizer
from .state import Episodes, Losses, Normalizer, TrainState, Validation

PURPOSES = ("init", "train", "validation")


class Bounded(Protocol):
    """Whatever knows the bounds of a flat observation."""

    @property
    def low(self) -> np.ndarray:
        """Lowest value of each feature."""
        ...

    @property
    def high(self) -> np.ndarray:
        """Highest value of each feature."""
        ...


def purpose_key(seed: Int[Array, ""], purpose: Literal["init", "train", "validation"]) -> PRNGKeyArray:
    """The key of one purpose of the run with this seed: streams that never meet."""
    return jax.random.fold_in(jax.random.key(seed), PURPOSES.index(purpose))


def normalizer_of(space: Bounded, config: Config) -> tuple[Normalizer, np.ndarray]:
    """The scaling that needs no data, and for which features it is final.

    Features with finite bounds go to [−1, 1]; the others keep their size until `refit_normalizer`.
    """
    low, high = (np.asarray(bound, np.float32).ravel() for bound in (space.low, space.high))
    bounded = (np.abs(low) < UNBOUNDED) & (np.abs(high) < UNBOUNDED) & (high > low) & config.trust_bounds
    scaled = bounded & config.normalize_obs
    low, high = np.where(scaled, low, -1), np.where(scaled, high, 1)
    # constants of the program, in NumPy: making them JAX arrays here would compile two programs more
    affine: Any = ((low + high) / 2).astype(np.float32), (2 / (high - low)).astype(np.float32)
    return Normalizer(*affine), bounded | (not config.normalize_obs)


def refit_normalizer(normalizer: Normalizer, rollout: Transition, bounded: np.ndarray) -> Normalizer:
    """From the first chunk: features without bounds get mean 0 and standard deviation ½, if they move (`moves`)."""
    x = rollout.observation[0].reshape(-1, bounded.shape[0])
    moving, mean, scale = center_and_scale(x)
    moves = ~bounded & moving
    return Normalizer(jnp.where(moves, mean, normalizer.shift), jnp.where(moves, scale, normalizer.scale))


def are_held(rollout: Transition) -> Bool[Array, " features"]:
    """Whether the first chunk has no number that is not finite, or too large to be scaled, feature by feature."""
    x = rollout.observation[0].reshape(-1, rollout.observation.shape[-1])
    return jnp.max(jnp.abs(x), axis=0) <= LARGEST


def init_networks(
    config: Config,
    distribution: Distribution,
    num_features: int,
    hyper: Hyperparameters,
    key: PRNGKeyArray,
) -> Networks:
    """A random actor and a random critic."""
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


def init_state(
    config: Config,
    distribution: Distribution,
    normalizer: Normalizer,
    hyper: Hyperparameters,
    seed: Int[Array, ""],
) -> TrainState:
    """Before the first step; the environments are not started yet."""
    num_features = normalizer.shift.shape[0]
    networks: Any = init_networks(config, distribution, num_features, hyper, purpose_key(seed, "init"))
    return TrainState(
        networks=networks,
        opt_state=optimizer(hyper, jnp.float32(1), networks).init(networks),
        normalizer=normalizer,
        outside=jnp.zeros((2, num_features), bool),
        env_state=None,
        observation=None,
        key=jax.random.key_data(purpose_key(seed, "train")),
        timestep=jnp.int32(0),
        iteration=jnp.int32(0),
        episodes=Episodes.zeros(config.num_envs),
        losses=Losses.zeros(),
        validation=Validation.create(networks.actor),
    )
