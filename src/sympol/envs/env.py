"""The protocol of an environment written in JAX.

An environment is a frozen value with two spaces and two pure functions. It never resets itself: it returns the true
last observation with ``terminated`` and ``truncated`` apart, and the training loop starts the next episode. The
functions describe ONE environment; a caller that needs many maps them with `jax.vmap`.

A complete environment, a walk to the right end of a line:

>>> from dataclasses import dataclass
>>> from typing import NamedTuple
>>> import gymnasium, jax, jax.numpy as jnp, numpy as np
>>> from sympol.types import Step
>>> class WalkState(NamedTuple):
...     position: jax.Array
...     time: jax.Array
>>> @dataclass(frozen=True)
... class Walk:
...     max_episode_steps: int = 50
...     feature_names = ("position",)
...     action_names = ("left", "right")
...     observation_space = gymnasium.spaces.Box(0, 1, (1,), np.float32)
...     action_space = gymnasium.spaces.Discrete(2)
...     def reset(self, key):
...         state = WalkState(jax.random.uniform(key, maxval=0.5), jnp.int32(0))
...         return state, state.position[None]
...     def step(self, key, state, action):
...         position = jnp.clip(state.position + 0.1 * (2 * action - 1), 0, 1)
...         state = WalkState(position, state.time + 1)
...         ended = position >= 1
...         return state, Step(position[None], jnp.where(ended, 1.0, 0.0), ended, state.time >= self.max_episode_steps)

It is trained on as it is, or registered under a name:

>>> import sympol
>>> sympol.register("Walk-v0", Walk)
>>> spec = sympol.resolve("Walk-v0")
>>> spec.backend, spec.features.names, spec.max_episode_steps
('jax', ('position',), 50)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar, runtime_checkable

import gymnasium

from ..types import Action, Step

if TYPE_CHECKING:
    from jax import Array
    from jaxtyping import Float, PRNGKeyArray

MAX_EPISODE_STEPS = 10_000
"""Number of steps after which an episode is cut when a policy is evaluated and there is no time limit."""

State = TypeVar("State", bound=Any)


@runtime_checkable
class Env(Protocol[State]):
    """A pure-JAX environment; any object of this shape can be trained on.

    `sympol.resolve` also accepts rewards and observations of another dtype, Python's own numbers and bools, and keys of
    `jax.random` in the state; `sympol.envs.jax_protocol` casts them.

    The observation is a flat float32 vector, one number per feature. The action is an int32 scalar in
    ``[0, n)`` for ``Discrete(n)``, an int32 vector for ``MultiDiscrete``, and for ``Box`` a float32 array of
    the space's shape, already clipped to its bounds.

    Optional attributes, each read where an environment has it:

    - ``feature_names``, ``action_names``: sequences of str, one per feature, and one per action or action component.
    - ``groups``: features that are one-hot together, as `sympol.trees.groups.Group`. A group with a ``cell`` is drawn
      as a cell of a grid that the agent sees.
    - ``max_episode_steps``: an int, or None for no limit.
    - ``all_observations()``: all observations there can be ``[batch, features]``, or None where they cannot be
      listed. Trees are pruned on them.
    - ``state_graph()``: all states and transitions, a `sympol.envs.capabilities.StateGraph`, or None where they
      cannot be listed. Policies are then evaluated in a table.
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
        """Start an episode.

        Args:
            key: The source of everything random in the start.

        Returns:
            The state, and the first observation.
        """
        ...

    def step(self, key: PRNGKeyArray, state: State, action: Action) -> tuple[State, Step]:
        """Advance by one action, without resetting at the end of an episode.

        Args:
            key: The source of everything random in the step.
            state: The state; it counts the steps where there is a time limit.
            action: The action, already clipped to the bounds of a ``Box``.

        Returns:
            The new state, and the observation, reward and end of the episode as a `Step`.
        """
        ...
