"""Environments of MuJoCo Playground."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import jax

from ..foreign import ForeignEnv, Library
from .brax import EPISODE_LENGTH, StateEnv


class Playground(Library):
    """The environments of MuJoCo Playground by name; arguments are entries of their configuration."""

    prefix = "playground"
    package = "mujoco_playground"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library("registry").ALL_ENVS

    def make(self, name: str, *, max_episode_steps: int | None = None, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        registry = self.library("registry")
        if jax.default_backend() == "cpu" and "impl" in registry.get_default_config(name):
            kwargs.setdefault(
                "impl", "jax"
            )  # the default, MuJoCo Warp, is for GPUs: there it takes 40 times as long
        env = registry.load(name, config_overrides=kwargs or None)
        return StateEnv(f"playground:{name}", env, max_episode_steps or _length(env))

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`; wrappers, of which one goes back to the first state, are taken off."""
        inner = env.unwrapped
        return StateEnv(f"playground:{type(inner).__name__}", inner, _length(inner))


def _length(env: Any) -> int:
    return int(getattr(env._config, "episode_length", EPISODE_LENGTH))
