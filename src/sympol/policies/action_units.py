"""The unit in which an actor learns the means of continuous actions.

An environment may take actions in any range, such as 0 to 100. Learning is the same in each if means, their standard
deviation and steps of the optimizer are in units of about half that range. The unit is a power of two, so that a
product with it rounds nothing: the tree that is extracted, in the units of the environment, acts to the bit as the
actor does.
"""

from __future__ import annotations

from typing import Any, TypeVar

import equinox as eqx
import gymnasium
import jax.numpy as jnp
import numpy as np

from .mlp import MLPActor

UNBOUNDED = 1e6
"""A bound of an action that is as large as this one, or larger, counts as none."""

ActorT = TypeVar("ActorT", bound=Any)


def units_and_centers(space: gymnasium.Space, *, scaled: bool) -> tuple[np.ndarray, np.ndarray]:
    """Compute the unit of each component of an action and the middle of its range in that unit.

    Args:
        space: The action space.
        scaled: Whether components with two finite bounds have a unit of their own.

    Returns:
        The units, float32 powers of two, of which half the range is between 1 and 2; and the centers. Units are 1
        and centers 0 for components without two bounds, and throughout where ``scaled`` is false. Both are empty for
        actions that are not continuous.
    """
    if not isinstance(space, gymnasium.spaces.Box):
        return np.ones(0, np.float32), np.zeros(0, np.float32)
    low, high = (bound.astype(np.float64).ravel() for bound in (space.low, space.high))
    bounded = (np.abs(low) < UNBOUNDED) & (np.abs(high) < UNBOUNDED) & (high > low) & scaled
    half = np.where(bounded, (high - low) / 2, 1.0)
    units = np.exp2(np.clip(np.floor(np.log2(half)), -100, 100))
    centers = np.where(bounded, (low + high) / 2, 0.0) / units
    return units.astype(np.float32), centers.astype(np.float32)


def multiply_outputs(actor: ActorT, factors: np.ndarray) -> ActorT:
    """Return an actor whose means, and their standard deviations, are multiplied by powers of two.

    Args:
        actor: A `Tree`, a `SoftTree` or an `MLPActor`.
        factors: A power of two for each output; empty for actions that are not continuous.

    Returns:
        The actor. Its means are exact products, unless they leave the range of float32.
    """
    if (factors == 1).all():  # as where there are none
        return actor
    row = jnp.asarray(factors, jnp.float32)
    log_std = actor.log_std + jnp.asarray(np.log(factors.astype(np.float64)), jnp.float32)
    actor = eqx.tree_at(lambda a: a.log_std, actor, log_std)
    if not isinstance(actor, MLPActor):
        return eqx.tree_at(lambda a: a.leaf_values, actor, actor.leaf_values * row[None])
    return eqx.tree_at(
        lambda a: (a.net.weights[-1], a.net.biases[-1]),
        actor,
        (actor.net.weights[-1] * row[None], actor.net.biases[-1] * row),
    )


def add_to_outputs(actor: ActorT, offsets: np.ndarray) -> ActorT:
    """Return an actor whose means are moved, for its first steps in the middle of the range of actions.

    Args:
        actor: A `Tree`, a `SoftTree` or an `MLPActor`.
        offsets: A number for each output; empty for actions that are not continuous.

    Returns:
        The actor.
    """
    if (offsets == 0).all():
        return actor
    row = jnp.asarray(offsets, jnp.float32)
    if isinstance(actor, MLPActor):
        return eqx.tree_at(lambda a: a.net.biases[-1], actor, actor.net.biases[-1] + row)
    return eqx.tree_at(lambda a: a.leaf_values, actor, actor.leaf_values + row[None])
