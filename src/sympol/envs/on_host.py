"""An environment in JAX behind Gymnasium's interface, for worlds that exist in JAX alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, final

import gymnasium
import jax
import numpy as np

from .env import Env
from .jax_protocol import kept_to_protocol


@final
class OnHost(gymnasium.Env[Any, Any]):
    """The form in Gymnasium of an environment written in JAX, to evaluate policies on.

    Environments that are equal, as frozen dataclasses with equal fields are, share their compiled functions.

    Args:
        env: The environment in JAX.

    Raises:
        ValueError: The environment does not keep the protocol of `Env`.
    """

    def __init__(self, env: Env) -> None:
        self.env = kept_to_protocol(env)
        self.observation_space, self.action_space = env.observation_space, env.action_space
        self._reset, self._step = _compiled(self.env) if _is_hashable(self.env) else _compile(self.env)
        self._key: Any = None
        self._state: Any = None

    def __getattr__(self, name: str) -> Any:
        """Whatever else the environment has, such as ``feature_names``."""
        if name.startswith("_") or name == "env":
            raise AttributeError(name)
        return getattr(self.env, name)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode.

        Args:
            seed: The seed of this episode and of those after it.
            options: Ignored.

        Returns:
            The first observation, and an empty ``info``.
        """
        super().reset(seed=seed)
        self._key, key = jax.random.split(jax.random.key(int(self.np_random.integers(2**32))))
        self._state, observation = self._reset(key)
        return np.array(observation), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take one step.

        Args:
            action: An action of the space.

        Returns:
            Observation, reward, terminated, truncated, and an empty ``info``.
        """
        self._key, key = jax.random.split(self._key)
        is_box = isinstance(self.action_space, gymnasium.spaces.Box)
        taken = np.asarray(action, np.float32 if is_box else np.int32)
        self._state, (observation, reward, terminated, truncated) = self._step(key, self._state, taken)
        return np.array(observation), float(reward), bool(terminated), bool(truncated), {}


def _compile(env: Env) -> tuple[Callable[..., Any], Callable[..., Any]]:
    return jax.jit(env.reset), jax.jit(env.step)


_compiled = lru_cache(maxsize=16)(_compile)


def _is_hashable(value: object) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True
