"""Gymnasium's functional environments, `gymnasium.experimental.functional.FuncEnv`."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium
import jax.numpy as jnp
from jax import Array

from ..entries import Adapter, Entry
from ..foreign import Answer, ForeignEnv, is_of
from .gymnasium import make

_CLASSES = {
    "phys2d/CartPole-v0": ("gymnasium.envs.phys2d.cartpole", "CartPoleFunctional"),
    "phys2d/CartPole-v1": ("gymnasium.envs.phys2d.cartpole", "CartPoleFunctional"),
    "phys2d/Pendulum-v0": ("gymnasium.envs.phys2d.pendulum", "PendulumFunctional"),
    "tabular/Blackjack-v0": ("gymnasium.envs.tabular.blackjack", "BlackjackFunctional"),
}
"""The module and class of Gymnasium's own, by id."""


class Functional(Adapter):
    """Gymnasium's own functional environments by id, and those of users as objects."""

    def entry(self, env_id: str) -> Entry | None:
        """See `Adapter.entry`."""
        if env_id not in _CLASSES:
            return None
        return Entry(partial(_made, env_id), partial(make, env_id))

    def ids(self) -> Iterable[str]:
        """See `Adapter.ids`."""
        return _CLASSES

    def adopt(self, env: Any) -> ForeignEnv | None:
        """See `Adapter.adopt`."""
        if not is_of("gymnasium.experimental.functional", env):
            return None
        return FunctionalEnv(type(env).__name__, env, getattr(env, "max_episode_steps", None))


class FunctionalEnv(ForeignEnv):
    """A functional environment. It has no time limit unless it is given one."""

    def __init__(self, name: str, env: Any, max_episode_steps: int | None) -> None:
        self.env = env
        super().__init__(name, env.observation_space, env.action_space, max_episode_steps)

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        state = self.env.initial(key)
        return state, self.env.observation(state, key)

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        start = getattr(self.action_space, "start", None)
        if start is not None:
            action = action + jnp.asarray(start, action.dtype)
        after = self.env.transition(state, action, key)
        return Answer(
            after,
            self.env.observation(after, key),
            self.env.reward(state, action, after, key),
            self.env.terminal(after, key),
        )


def _made(env_id: str, *, max_episode_steps: int | None = None, **options: Any) -> ForeignEnv:
    module, name = _CLASSES[env_id]
    env = getattr(import_module(module), name)(options or None)
    return FunctionalEnv(env_id, env, max_episode_steps or gymnasium.spec(env_id).max_episode_steps)
