"""Environments of navix."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from jax import Array

from ..foreign import Answer, ForeignEnv, Library

_CHANNELS = {"object": 10, "colour": 5, "state": 3}
"""The three numbers of a cell in navix's symbolic observations, and the largest value of each; the declared bounds of
some of navix's functions are smaller than what they return."""


class Navix(Library):
    """The environments of navix by the ids of `navix.make`; ``observation_fn`` may be the name of its function."""

    prefix = package = "navix"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library().registry()

    def make(self, name: str, *, max_episode_steps: int | None = None, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        if isinstance(function := kwargs.get("observation_fn"), str):
            kwargs["observation_fn"] = getattr(self.library().observations, function)
        if max_episode_steps is not None:
            kwargs["max_steps"] = max_episode_steps
        return NavixEnv(f"navix:{name}", self.library().make(name, **kwargs))

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`."""
        return NavixEnv(f"navix:{type(env).__name__}", env)


class NavixEnv(ForeignEnv):
    """An environment of navix, whose public ``step`` resets by itself; this takes the one inside it."""

    def __init__(self, name: str, env: Any) -> None:
        self.env = env
        shape = tuple(env.observation_space.shape)
        low, high = (
            np.broadcast_to(np.asarray(bound), shape).astype(np.int32)
            for bound in (env.observation_space.minimum, env.observation_space.maximum)
        )
        symbolic = len(shape) == 3 and env.observation_fn.__name__.startswith("symbolic")
        if symbolic:
            high = np.broadcast_to(np.array([*_CHANNELS.values()], np.int32), shape)
        names = [*_CHANNELS]
        super().__init__(
            name,
            Box(low, high, dtype=np.int32),
            Discrete(int(env.action_space.n)),
            int(env.max_steps),
            feature_names=tuple(f"{names[c]} at [{i}, {j}]" for i, j, c in np.ndindex(shape))
            if symbolic
            else None,
            action_names=tuple(
                getattr(act, "__name__", f"action {i}") for i, act in enumerate(env.action_set)
            ),
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        timestep = self.env.reset(key)
        return timestep, timestep.observation

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        after = self.env._step(state, action)
        return Answer(after, after.observation, after.reward, after.is_termination(), after.is_truncation())
