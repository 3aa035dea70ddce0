"""A small world with a protocol of its own, as a package for environments in JAX may have, and an adapter for it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from sympol.envs.entries import Adapter, Entry
from sympol.envs.on_host import OnHost
from sympol.types import Step


class Params(NamedTuple):
    """The foreign package's parameters of a world."""

    height: int = 4
    max_steps: int = 12


class Ladder:
    """The foreign world: climb to the top; observation before state, one flag, and a reset inside ``step``."""

    num_actions = 2
    num_observations = 2

    def reset(self, key: PRNGKeyArray, params: Params) -> tuple[Array, Array]:
        state = jnp.stack([jax.random.randint(key, (), 0, params.height - 1), jnp.int32(0)])
        return self.observe(state, params), state

    def step(self, key: PRNGKeyArray, state: Array, action: Array, params: Params) -> tuple[Any, ...]:
        observation, after, reward, done, info = self.step_env(key, state, action, params)
        first, begun = self.reset(key, params)
        return jnp.where(done, first, observation), jnp.where(done, begun, after), reward, done, info

    def step_env(self, key: PRNGKeyArray, state: Array, action: Array, params: Params) -> tuple[Any, ...]:
        rung, time = state
        after = jnp.stack([jnp.clip(rung + 2 * action - 1, 0, params.height), time + 1])
        arrived = after[0] == params.height
        done = arrived | (after[1] >= params.max_steps)
        return self.observe(after, params), after, jnp.where(arrived, 1, 0), done, {"arrived": arrived}

    def observe(self, state: Array, params: Params) -> Array:
        return jnp.stack([state[0] / params.height, (params.max_steps - state[1]) / params.max_steps])


@dataclass(frozen=True)
class Adapted:
    """The same world, in the protocol of `sympol.envs.env.Env`."""

    height: int = Params().height

    feature_names = ("rung", "time left")
    action_names = ("down", "up")
    observation_space = gymnasium.spaces.Box(0, 1, (Ladder.num_observations,), np.float32)
    action_space = gymnasium.spaces.Discrete(Ladder.num_actions)

    @property
    def max_episode_steps(self) -> int:
        return Params().max_steps

    def reset(self, key: PRNGKeyArray) -> tuple[Int[Array, " 2"], Float[Array, " 2"]]:
        observation, state = Ladder().reset(key, Params(self.height))
        return state, observation

    def step(self, key: PRNGKeyArray, state: Int[Array, " 2"], action: Int[Array, ""]) -> tuple[Array, Step]:
        observation, state, reward, done, info = Ladder().step_env(key, state, action, Params(self.height))
        arrived = info["arrived"]
        return state, Step(observation, reward, arrived, done & ~arrived)


class Toy(Adapter):
    """The worlds whose ids begin with ``toy/``."""

    def entry(self, env_id: str) -> Entry | None:
        return Entry(Adapted, _on_host) if env_id in self.ids() else None

    def ids(self) -> Iterable[str]:
        return ("toy/Ladder-v0",)


def _on_host(**kwargs: Any) -> OnHost:
    return OnHost(Adapted(**kwargs))
