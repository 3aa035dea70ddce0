"""Environments of brax."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from gymnasium.spaces import Box
from jax import Array

from ..foreign import Answer, ForeignEnv, Library, space_like

EPISODE_LENGTH = 1000
"""The time limit with which brax trains."""


class Brax(Library):
    """The environments of brax by the names of `brax.envs.get_environment`."""

    prefix = package = "brax"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library("envs")._envs

    def make(self, name: str, *, max_episode_steps: int = EPISODE_LENGTH, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        return StateEnv(
            f"brax:{name}", self.library("envs").get_environment(name, **kwargs), max_episode_steps
        )

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`; brax's wrappers are taken off, of which one resets and others batch."""
        limit = getattr(env, "episode_length", None)
        while limit is None and hasattr(env, "env"):
            env = env.env
            limit = getattr(env, "episode_length", None)
        inner = env.unwrapped
        return StateEnv(f"brax:{type(inner).__name__.lower()}", inner, limit or EPISODE_LENGTH)


class StateEnv(ForeignEnv):
    """An environment whose functions take and return one state, as those of brax and of MuJoCo Playground do.

    Their torques are between −1 and 1. Where the observation has a part named ``state``, the others are for critics
    that may know more than the policy, and are left out.
    """

    def __init__(self, name: str, env: Any, max_episode_steps: int | None) -> None:
        self.env = env
        seen = jax.eval_shape(env.reset, jax.ShapeDtypeStruct((2,), np.uint32)).obs
        super().__init__(
            name,
            space_like(_for_policy(seen)),
            Box(-1, 1, (int(env.action_size),), np.float32),
            max_episode_steps,
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        state = self.env.reset(key)
        return state, _for_policy(state.obs)

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        after = self.env.step(state, action)
        return Answer(after, _for_policy(after.obs), after.reward, after.done > 0)


def _for_policy(observation: Any) -> Any:
    return observation["state"] if isinstance(observation, dict) and "state" in observation else observation
