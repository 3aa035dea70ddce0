"""Environments so small that what a learner must find in them is known. Each isolates one part of it.

Where a critic fails, `ConstantValue` to `TimeLimit` say why, in that order; then `RewardOfAction` and the rest
do the same for the actor.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import NamedTuple, final

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from sympol.types import Action, Step


class ProbeState(NamedTuple):
    observation: Float[Array, " features"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class Probe(abc.ABC):
    """Shows an observation, pays for the action, ends after ``length`` steps or is cut at ``max_episode_steps``."""

    length: int | None = 1
    max_episode_steps: int = 1000

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        shape = jax.eval_shape(self.draw, jax.random.key(0)).shape
        return gymnasium.spaces.Box(-1, 1, shape, np.float32)

    @property
    def action_space(self) -> gymnasium.Space:
        return gymnasium.spaces.Discrete(2)

    @abc.abstractmethod
    def draw(self, key: PRNGKeyArray) -> Float[Array, " features"]:
        """The first observation."""

    @abc.abstractmethod
    def reward(self, observation: Float[Array, " features"], action: Action) -> Float[Array, ""]: ...

    def next(self, observation: Float[Array, " features"]) -> Float[Array, " features"]:
        return observation

    def reset(self, key: PRNGKeyArray) -> tuple[ProbeState, Float[Array, " features"]]:
        observation = self.draw(key)
        return ProbeState(observation, jnp.int32(0)), observation

    def step(self, key: PRNGKeyArray, state: ProbeState, action: Action) -> tuple[ProbeState, Step]:
        observation, time = self.next(state.observation), state.time + 1
        terminated = jnp.bool_(False) if self.length is None else time >= self.length
        return ProbeState(observation, time), Step(
            observation, self.reward(state.observation, action), terminated, time >= self.max_episode_steps
        )


def sign(key: PRNGKeyArray, num: int = 1) -> Float[Array, " num"]:
    return jax.random.rademacher(key, (num,), jnp.float32)


@final
class ConstantValue(Probe):
    """Reward 1, whatever one does: the value is 1."""

    def draw(self, key: PRNGKeyArray) -> Array:
        return jnp.zeros(1, jnp.float32)

    def reward(self, observation: Array, action: Action) -> Array:
        return jnp.float32(1)


@final
class ValueOfObservation(Probe):
    """Reward is the observation, −1 or 1: so is the value."""

    def draw(self, key: PRNGKeyArray) -> Array:
        return sign(key)

    def reward(self, observation: Array, action: Action) -> Array:
        return observation[0]


@final
@dataclass(frozen=True)
class Discount(Probe):
    """Observation 0, then 1; only the second step pays 1. The values are gamma and 1."""

    length: int | None = 2

    def draw(self, key: PRNGKeyArray) -> Array:
        return jnp.zeros(1, jnp.float32)

    def next(self, observation: Array) -> Array:
        return jnp.ones_like(observation)

    def reward(self, observation: Array, action: Action) -> Array:
        return observation[0]


@final
@dataclass(frozen=True)
class TimeLimit(Probe):
    """Reward 1 for ever, cut by the clock after 5 steps: the value is 1 / (1 − gamma), not 5 steps' worth."""

    length: int | None = None
    max_episode_steps: int = 5

    def draw(self, key: PRNGKeyArray) -> Array:
        return jnp.zeros(1, jnp.float32)

    def reward(self, observation: Array, action: Action) -> Array:
        return jnp.float32(1)


@final
class RewardOfAction(Probe):
    """Action 1 pays 1, action 0 pays −1. Always take action 1: the value is 1."""

    def draw(self, key: PRNGKeyArray) -> Array:
        return jnp.zeros(1, jnp.float32)

    def reward(self, observation: Array, action: Action) -> Array:
        return jnp.where(action == 1, jnp.float32(1), jnp.float32(-1))


@final
class MatchObservation(Probe):
    """Action 1 pays 1 where the observation is 1, action 0 where it is −1, else −1. The value is 1."""

    def draw(self, key: PRNGKeyArray) -> Array:
        return sign(key)

    def reward(self, observation: Array, action: Action) -> Array:
        return jnp.where((action == 1) == (observation[0] > 0), jnp.float32(1), jnp.float32(-1))


@final
class ContinuousMatch(Probe):
    """Observation −0.5 or 0.5; reward −(action − observation)². The action is the observation, the value 0."""

    @property
    def action_space(self) -> gymnasium.spaces.Box:
        return gymnasium.spaces.Box(-1, 1, (1,), np.float32)

    def draw(self, key: PRNGKeyArray) -> Array:
        return sign(key) / 2

    def reward(self, observation: Array, action: Action) -> Array:
        return -jnp.square(action[0] - observation[0])


@final
class MultiDiscreteMatch(Probe):
    """Two signs. Component 0 (of 2) must be 1 where the first is 1, else 0; component 1 (of 3) must be 2 where
    the second is 1, else 0. Each that is right pays 1: the value is 2."""

    @property
    def action_space(self) -> gymnasium.spaces.MultiDiscrete:
        return gymnasium.spaces.MultiDiscrete([2, 3])

    def draw(self, key: PRNGKeyArray) -> Array:
        return sign(key, 2)

    def reward(self, observation: Array, action: Action) -> Array:
        wanted = jnp.where(observation > 0, jnp.array([1, 2], jnp.int32), jnp.zeros(2, jnp.int32))
        return jnp.sum((action == wanted).astype(jnp.float32))


PROBES: tuple[Probe, ...] = (
    ConstantValue(),
    ValueOfObservation(),
    Discount(),
    TimeLimit(),
    RewardOfAction(),
    MatchObservation(),
    ContinuousMatch(),
    MultiDiscreteMatch(),
)
