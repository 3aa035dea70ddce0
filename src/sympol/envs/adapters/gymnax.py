"""Environments of gymnax, of its versions 0.0.9 and 1.0."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, Tuple
from jax import Array

from ..foreign import NEVER, Answer, ForeignEnv, Library
from .classic import in_jax


class Gymnax(Library):
    """The environments of gymnax by the ids of `gymnax.make`; arguments may be fields of its parameters."""

    prefix = package = "gymnax"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library().registered_envs

    def make(self, name: str, *, max_episode_steps: int | None = None, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        _, defaults = self.library().make(name)
        of_params = {key: value for key, value in kwargs.items() if hasattr(defaults, key)}
        env, params = self.library().make(
            name, **{key: kwargs[key] for key in kwargs.keys() - of_params.keys()}
        )
        if max_episode_steps is not None:
            of_params["max_steps_in_episode"] = max_episode_steps
        return GymnaxEnv(f"gymnax:{name}", env, params.replace(**of_params))

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`; ``(env, params)`` as `gymnax.make` returns them are taken, too."""
        env, params = env if isinstance(env, tuple) else (env, env.default_params)
        if not hasattr(env, "step_env") or type(env).__module__.startswith("gymnax.wrappers"):
            raise ValueError(
                f"{type(env).__name__} is a wrapper of gymnax's, whose step resets by itself; give the environment "
                "inside it"
            )
        wrapped = GymnaxEnv(f"gymnax:{env.name}", env, params)
        wrapped.recipe = self._recipe(env, params)
        return wrapped

    def _recipe(self, env: Any, params: Any) -> dict[str, Any] | None:
        """Return the arguments that make the same environment again by its name, or None."""
        if env.name not in self.names():
            return None
        made, defaults = self.library().make(env.name)
        if type(made) is not type(env) or not _are_equal(vars(made), vars(env)):
            return None
        now, then = vars(params), vars(defaults)
        return {field: now[field] for field in now if not _are_equal(now[field], then.get(field))}


class GymnaxEnv(ForeignEnv):
    """An environment of gymnax with its parameters.

    Version 1.0 tells a time limit from a terminal state. In version 0.0 the raw step calls both done, so it is asked
    once more with a time limit that no episode reaches; the compiler merges what the two have in common.
    """

    def __init__(self, name: str, env: Any, params: Any) -> None:
        limit = getattr(params, "max_steps_in_episode", None)
        self.env, self.params = env, params
        self.tells_apart = hasattr(env, "is_truncated")
        self.endless = params if limit is None else params.replace(max_steps_in_episode=NEVER)
        observed = _space(env.observation_space(params))
        ours = in_jax(name.partition(":")[2])
        same = ours is not None and ours.observation_space.shape == observed.shape
        super().__init__(
            name,
            observed,
            _space(env.action_space(params)),
            None if limit is None else int(limit),
            feature_names=getattr(ours, "feature_names", None) if same else None,
            action_names=getattr(ours, "action_names", None) if same else None,
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        observation, state = self.env.reset_env(key, self.params)
        return state, observation

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        observation, after, reward, done, _ = self.env.step_env(key, state, action, self.params)
        if self.tells_apart:
            return Answer(after, observation, reward, done, self.env.is_truncated(after, self.params))
        terminated = self.env.step_env(key, state, action, self.endless)[3]
        return Answer(after, observation, reward, terminated, done & ~terminated)


def _are_equal(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_are_equal(one[key], other[key]) for key in one)
    return type(one) is type(other) and np.array_equal(one, other)


def _space(space: Any) -> gymnasium.Space:
    """Return gymnax's space as one of Gymnasium's; the classes are told by name, to import nothing."""
    match type(space).__name__:
        case "Discrete":
            return Discrete(int(space.n))
        case "Box":
            low, high = (
                np.broadcast_to(np.asarray(b, np.float64), space.shape) for b in (space.low, space.high)
            )
            dtype: Any = np.int32 if np.issubdtype(np.dtype(space.dtype), np.integer) else np.float32
            return Box(low.astype(dtype), high.astype(dtype), dtype=dtype)
        case "Dict":
            return Dict({str(name): _space(part) for name, part in space.spaces.items()})
        case "Tuple":
            return Tuple([_space(part) for part in space.spaces])
    raise ValueError(f"gymnax's space must be Discrete, Box, Dict or Tuple, got {space}")
