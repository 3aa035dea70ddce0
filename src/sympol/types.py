"""Types shared by all packages."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from jax import Array
from jaxtyping import Bool, Float, Int

Action: TypeAlias = Int[Array, "..."] | Float[Array, "..."]


class Step(NamedTuple):
    """The result of one action, before any reset.

    Attributes:
        observation: The observation after the action; the true last one if the episode ends here.
        reward: The reward of the action.
        terminated: Whether the task itself ended.
        truncated: Whether only a time limit ended the episode.
    """

    observation: Float[Array, "*batch features"]
    reward: Float[Array, "*batch"]
    terminated: Bool[Array, "*batch"]
    truncated: Bool[Array, "*batch"]


class Transition(NamedTuple):
    """One step of experience; leading axes are ``[num_steps, num_envs]``.

    ``action`` is stored as it was sampled, neither clipped nor rounded. ``last_observation`` is the observation after
    the step, even if the episode ended there: the next row may already belong to a new episode.
    """

    observation: Float[Array, "*batch features"]
    action: Action
    reward: Float[Array, "*batch"]
    terminated: Bool[Array, "*batch"]
    truncated: Bool[Array, "*batch"]
    last_observation: Float[Array, "*batch features"]
