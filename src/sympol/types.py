"""Types shared by all packages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, TypeAlias

if TYPE_CHECKING:  # a process that steps environments on the host imports no JAX
    from jax import Array
    from jaxtyping import Bool, Float, Int

Action: TypeAlias = "Int[Array, '...'] | Float[Array, '...']"


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
    """Steps of experience; leading axes are ``[steps, envs]``, in a rollout ``[chunks, steps, envs]``.

    Attributes:
        observation: The observation that the action answered, in a rollout scaled for the networks.
        action: The action as it was sampled, neither clipped nor rounded.
        reward: The reward of the step.
        terminated: True where the step ended the episode in a terminal state.
        truncated: True where a time limit ended the episode.
        last_observation: The observation after the step, scaled like ``observation``, even if the episode ended there:
            the next row may already belong to a new episode.
    """

    observation: Float[Array, "*batch features"]
    action: Action
    reward: Float[Array, "*batch"]
    terminated: Bool[Array, "*batch"]
    truncated: Bool[Array, "*batch"]
    last_observation: Float[Array, "*batch features"]
