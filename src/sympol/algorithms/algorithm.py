"""The interface of an algorithm: how experience becomes better networks.

A new algorithm is a subclass in a file of its own and a line in `registry.ALGORITHMS`. Everything else is the same for
all algorithms: where experience comes from, how the rollout grows, validation, checkpoints and metrics
(`sympol.algorithms.loop`).
"""

from __future__ import annotations

import abc
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..policies.distributions import Distribution
from ..types import Action, Transition
from .config import Config, Hyperparameters
from .initialization import init_networks
from .optim import Networks
from .state import TrainState

Metrics = dict[str, Float[Array, ""]]
"""Scalars by name, such as ``"train/value_loss"``; the names are stable-baselines3's where it has them."""


class Experience(NamedTuple):
    """The experience of one rollout.

    Attributes:
        rollout: Transitions ``[chunks, steps, envs, ...]`` with scaled observations, of which the first
            ``2**stage`` chunks are valid.
        next_x: The scaled observations after the last step, ``[envs, features]``.
        stage: How often the rollout has doubled.
    """

    rollout: Transition
    next_x: Float[Array, "envs features"]
    stage: Int[Array, ""]

    @property
    def num_chunks(self) -> Int[Array, ""]:
        """The number of valid chunks."""
        return jnp.int32(1) << self.stage


class Algorithm(abc.ABC):
    """The pure functions of one algorithm; they run inside the compiled program.

    Args:
        config: The static part of the configuration. Its traced numbers are passed to `update` as ``hyper``.
        distribution: The distribution over actions that the actor's outputs parametrize.
        num_features: The number of features of a flat observation.
    """

    knobs: ClassVar[tuple[str, ...]] = ()
    """Fields of the config that are declared for other algorithms and that this one has, too."""

    def __init__(self, config: Config, distribution: Distribution, num_features: int) -> None:
        self.config = config
        self.distribution = distribution
        self.num_features = num_features

    def init_networks(self, hyper: Hyperparameters, key: PRNGKeyArray) -> Networks:
        """Create the actor and the critic with random parameters.

        Args:
            hyper: The traced hyperparameters.
            key: The key to draw them with.

        Returns:
            The networks; by default a state-value critic beside the actor of ``config.policy``.
        """
        return init_networks(self.config, self.distribution, self.num_features, hyper, key)

    def init_memory(self, networks: Networks) -> Any:
        """Create what the algorithm keeps beside its networks, such as a replay buffer or target networks.

        Args:
            networks: The networks at the start.

        Returns:
            A pytree of arrays, saved with every checkpoint; by default None.
        """
        return None

    def sample(
        self,
        outputs: Float[Array, "*batch outputs"],
        log_std: Float[Array, " num_std"],
        noise: Float[Array, "*batch noise"],
    ) -> Action:
        """Choose actions while experience is collected; by default drawn from the policy's distribution.

        Args:
            outputs: The actor's outputs.
            log_std: The actor's log standard deviation; empty for discrete actions.
            noise: What ``distribution.noise`` drew.

        Returns:
            The actions, as they are stored in the rollout.
        """
        return self.distribution.sample(outputs, log_std, noise)

    @abc.abstractmethod
    def update(
        self, hyper: Hyperparameters, state: TrainState, experience: Experience, key: PRNGKeyArray
    ) -> tuple[TrainState, Metrics]:
        """Learn from one rollout.

        Args:
            hyper: The traced hyperparameters.
            state: The state of the training; ``state.networks``, ``state.opt_state`` and ``state.memory`` are the
                algorithm's to replace.
            experience: The rollout that was collected with ``state.networks``.
            key: The key of everything random in this update.

        Returns:
            The new state, and the metrics of this update. A metric is reported, logged and saved by being in this
            dict.
        """


def checked_metrics(algorithm: Algorithm, state: TrainState, result: Any) -> Metrics:
    """Return the metrics among what `Algorithm.update` returned, given shapes in place of arrays.

    Args:
        algorithm: The algorithm.
        state: The state before the update.
        result: The shapes that `jax.eval_shape` found for its result.

    Returns:
        The shapes of the metrics by name.

    Raises:
        TypeError: The result is no state of the same form with a dictionary of scalar metrics.
    """
    name = f"{type(algorithm).__name__}.update"
    if not (isinstance(result, tuple) and len(result) == 2 and isinstance(result[1], dict)):
        raise TypeError(f"{name} must return the new state and a dictionary of metrics, got {result!r:.200}")
    updated, metrics = result
    for metric, value in metrics.items():
        if getattr(value, "shape", None) != ():
            raise TypeError(f"{name} must return scalar metrics, got {metric!r} of shape {value.shape}")
    before, after = (_forms(of) for of in (state, updated))
    for path in [path for path in {**before, **after} if before.get(path) != after.get(path)]:
        raise TypeError(
            f"{name} must return a state of the same form: {path.removeprefix('.')} was {before.get(path, 'absent')} "
            f"and is {after.get(path, 'absent')}"
        )
    return metrics


def _forms(state: Any) -> dict[str, str]:
    """Return the type and shape of each array by its path."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(path): f"{leaf.dtype}{list(leaf.shape)}" for path, leaf in leaves}


def mean_of(total: Any, count: Int[Array, ""]) -> Any:
    """Divide every array of a pytree of sums by their number."""
    return jax.tree.map(lambda a: a / count.astype(jnp.float32), total)


def zeros_of(shapes: Any) -> Any:
    """Return zeros in the shapes of a pytree that `jax.eval_shape` returned."""
    return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)
