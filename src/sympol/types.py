"""The few nouns that every room shares."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from jax import Array
from jaxtyping import Bool, Float, Int

Action: TypeAlias = Int[Array, "..."] | Float[Array, "..."]


class Step(NamedTuple):
    """What an environment answers to one action, before any reset.

    ``observation`` is the true last observation of an episode that ends here; ``terminated`` says that
    the task itself ended, ``truncated`` that only the clock did.
    """

    observation: Float[Array, "*batch features"]
    reward: Float[Array, "*batch"]
    terminated: Bool[Array, "*batch"]
    truncated: Bool[Array, "*batch"]


class Transition(NamedTuple):
    """One step of experience; leading axes are ``[num_steps, num_envs]``.

    ``action`` is stored as it was sampled (never clipped, never rounded). ``last_observation``
    is what the step led to, also when the episode ended there: the next row may already be a new episode.
    """

    observation: Float[Array, "*batch features"]
    action: Action
    reward: Float[Array, "*batch"]
    terminated: Bool[Array, "*batch"]
    truncated: Bool[Array, "*batch"]
    last_observation: Float[Array, "*batch features"]
