"""Environments of craftax."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from jax import Array

from ..foreign import NEVER, Answer, ForeignEnv, Library


class Craftax(Library):
    """The environments of craftax by the ids of its function; arguments are fields of its parameters."""

    prefix = package = "craftax"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return (
            "Craftax-Symbolic-v1",
            "Craftax-Classic-Symbolic-v1",
            "Craftax-Pixels-v1",
            "Craftax-Classic-Pixels-v1",
        )

    def make(self, name: str, *, max_episode_steps: int | None = None, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        env = self.library("craftax_env").make_craftax_env_from_name(name, auto_reset=False)
        if max_episode_steps is not None:
            kwargs["max_timesteps"] = max_episode_steps
        return CraftaxEnv(f"craftax:{name}", env, env.default_params.replace(**kwargs))

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`; ``(env, params)`` are taken, too."""
        env, params = env if isinstance(env, tuple) else (env, env.default_params)
        return CraftaxEnv(f"craftax:{env.name}", env, params)


class CraftaxEnv(ForeignEnv):
    """An environment of craftax, whose raw step is taken; resets cost more than ten steps."""

    def __init__(self, name: str, env: Any, params: Any) -> None:
        self.env, self.params = env, params
        self.endless = params.replace(max_timesteps=NEVER)
        shape = env.observation_space(params).shape
        super().__init__(
            name,
            Box(0, 1, shape, np.float32),
            Discrete(int(env.action_space(params).n)),
            int(params.max_timesteps),
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        observation, state = self.env.reset_env(key, self.params)
        return state, observation

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        observation, after, reward, *_ = self.env.step_env(key, state, action, self.params)
        return Answer(after, observation, reward, self.env.is_terminal(after, self.endless))
