"""The protocol of an environment written in JAX.

An environment is a frozen value with two spaces and two pure functions. It never resets itself: it returns
the true last observation with ``terminated`` and ``truncated`` apart, and `sympol.algorithms.rollouts` starts the
next episode. The functions describe ONE environment; whoever needs many maps them with `jax.vmap`.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeVar, runtime_checkable

import gymnasium
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..types import Action, Step

MAX_EPISODE_STEPS = 10_000
"""Where an episode that is only measured ends, in an environment without a time limit."""

State = TypeVar("State", bound=Any)


@runtime_checkable
class Env(Protocol[State]):
    """A pure-JAX environment; any object of this shape can be trained on.

    Where it is resolved, `sympol.envs.jax_env` makes these fit, too: rewards and observations of another dtype,
    Python's own numbers and bools, and keys of `jax.random` in the state.

    The observation is a flat float32 vector, one number per feature. The action is an int32 scalar in
    ``[0, n)`` for ``Discrete(n)``, an int32 vector for ``MultiDiscrete``, and for ``Box`` a float32 array of
    the space's shape, already clipped to its bounds.

    More attributes are read where an environment has them: ``feature_names`` and ``action_names`` (sequences of
    str, one per feature and per action or action component), ``groups`` (the features that are one-hot together),
    ``max_episode_steps`` (int, or None for no limit), and ``all_observations()``: all observations there can be
    ``[batch, features]``, where they can be listed, else None; then the tree is pruned on them.
    """

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Bounds of the flat observation."""
        ...

    @property
    def action_space(self) -> gymnasium.Space:
        """``Discrete``, ``Box`` or ``MultiDiscrete``."""
        ...

    def reset(self, key: PRNGKeyArray) -> tuple[State, Float[Array, " features"]]:
        """Start an episode: its state and its first observation."""
        ...

    def step(self, key: PRNGKeyArray, state: State, action: Action) -> tuple[State, Step]:
        """Advance by one action. The state counts the steps, for the time limit."""
        ...
