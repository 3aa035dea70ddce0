"""JAX environments for the evaluator: several choices at once, noise in each step, and a clock of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from sympol.types import Action, Step


class Walk(NamedTuple):
    place: Float[Array, " 3"]


@dataclass(frozen=True)
class NoisyWalk:
    """Three places that drift by two choices and by noise; the end beyond 1.5. No time limit."""

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.MultiDiscrete:
        return gymnasium.spaces.MultiDiscrete([3, 2])

    def reset(self, key: PRNGKeyArray) -> tuple[Walk, Float[Array, " 3"]]:
        place = jax.random.uniform(key, (3,), minval=-1, maxval=1)
        return Walk(place), place

    def step(self, key: PRNGKeyArray, state: Walk, action: Action) -> tuple[Walk, Step]:
        push = jnp.stack([action[0] - 1, 2 * action[1] - 1, action[0] - action[1]]).astype(jnp.float32)
        place = state.place + jnp.float32(0.1) * push + jnp.float32(0.3) * jax.random.normal(key, (3,))
        over = jnp.max(jnp.abs(place)) > 1.5
        return Walk(place), Step(place, jnp.sum(jnp.abs(place)) - 1, over, jnp.bool_(False))


class Count(NamedTuple):
    time: Array


@dataclass(frozen=True)
class Endless:
    """Goes on for ever, and sees the parity of the time; reward 1 for telling it."""

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(0, 1, (1,), np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        return gymnasium.spaces.Discrete(2)

    def reset(self, key: PRNGKeyArray) -> tuple[Count, Float[Array, " 1"]]:
        return Count(jnp.int32(0)), jnp.zeros(1)

    def step(self, key: PRNGKeyArray, state: Count, action: Action) -> tuple[Count, Step]:
        time = state.time + 1
        reward = (action == state.time % 2).astype(jnp.float32)
        return Count(time), Step(
            (time % 2).astype(jnp.float32)[None], reward, jnp.bool_(False), jnp.bool_(False)
        )


@dataclass(frozen=True)
class Broken(Endless):
    """Pays what is no number."""

    max_episode_steps: int = 3

    def step(self, key: PRNGKeyArray, state: Count, action: Action) -> tuple[Count, Step]:
        state, step = super().step(key, state, action)
        return state, step._replace(reward=jnp.float32(jnp.inf), truncated=state.time >= 3)
