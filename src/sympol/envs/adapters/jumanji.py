"""Environments of jumanji."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from jax import Array

from ..foreign import NEVER, Answer, ForeignEnv, Library

MOST_CATEGORIES = 16
"""A discrete number in an observation with more values than this, such as a count of steps, stays one number."""


class Jumanji(Library):
    """The environments of jumanji by the ids of `jumanji.make`."""

    prefix = package = "jumanji"

    def names(self) -> Iterable[str]:
        """See `Library.names`."""
        return self.library().registered_environments()

    def make(self, name: str, **kwargs: Any) -> ForeignEnv:
        """See `Library.make`."""
        return JumanjiEnv(f"jumanji:{name}", self.library().make(name, **_with_limit(kwargs)))

    def wrap(self, env: Any) -> ForeignEnv:
        """See `Library.wrap`; wrappers that reset by themselves are taken off."""
        return JumanjiEnv(f"jumanji:{type(env.unwrapped).__name__}", env.unwrapped)


class JumanjiEnv(ForeignEnv):
    """An environment of jumanji.

    Observations are features by name; an action mask is one of them. Actions that the mask excludes are still taken,
    and do what the environment does with them.

    jumanji calls the end at a time limit terminal. So the step is asked once more with a limit that no episode
    reaches; the compiler merges what the two have in common.
    """

    def __init__(self, name: str, env: Any) -> None:
        self.env = env
        limit = getattr(env, "time_limit", None)
        self.endless = env
        if limit is not None:
            self.endless = copy.copy(env)
            self.endless.time_limit = NEVER
        self.shape, self.lowest = tuple(env.action_spec.shape), _lowest(env.action_spec)
        super().__init__(
            name,
            _space(env.observation_spec),
            _actions(env.action_spec),
            None if limit is None else int(limit),
        )

    def begin(self, key: Array) -> tuple[Any, Any]:
        """See `ForeignEnv.begin`."""
        state, timestep = self.env.reset(key)
        return state, timestep.observation

    def advance(self, key: Array, state: Any, action: Array) -> Answer:
        """See `ForeignEnv.advance`."""
        action = (action + self.lowest).astype(self.env.action_spec.dtype).reshape(self.shape)
        after, timestep = self.env.step(state, action)
        terminated = _is_terminal(self.endless.step(state, action)[1])
        is_cut = timestep.last() & ~terminated
        return Answer(after, timestep.observation, timestep.reward.sum(), terminated, is_cut)


def _is_terminal(timestep: Any) -> Array:
    return timestep.last() & (timestep.discount == 0).all()


def _with_limit(kwargs: dict[str, Any]) -> dict[str, Any]:
    limit = kwargs.pop("max_episode_steps", None)
    return kwargs if limit is None else {**kwargs, "time_limit": limit}


def _space(spec: Any) -> gymnasium.Space:
    """Return the space of an observation; jumanji's classes are told by name, to import nothing."""
    kind = type(spec).__name__
    if kind == "DiscreteArray" and spec.num_values <= MOST_CATEGORIES:
        return Discrete(int(spec.num_values))
    if kind in ("DiscreteArray", "MultiDiscreteArray", "BoundedArray"):
        dtype: Any = np.float32 if np.issubdtype(spec.dtype, np.floating) else np.int32
        low, high = (
            np.broadcast_to(bound, spec.shape).astype(dtype) for bound in (spec.minimum, spec.maximum)
        )
        return Box(low, high, dtype=dtype)
    if kind == "Array":
        is_float = np.issubdtype(spec.dtype, np.floating)
        most = np.inf if is_float else np.iinfo(np.int32).max
        return Box(-most, most, spec.shape, np.float32 if is_float else np.int32)
    return Dict({name: _space(part) for name, part in spec._specs.items()})


def _lowest(spec: Any) -> Any:
    """Return what to add to actions that count from zero."""
    counts = type(spec).__name__ == "BoundedArray" and np.issubdtype(spec.dtype, np.integer)
    return np.ravel(np.broadcast_to(spec.minimum, spec.shape)) if counts else 0


def _actions(spec: Any) -> gymnasium.Space:
    match type(spec).__name__:
        case "DiscreteArray":
            return Discrete(int(spec.num_values))
        case "MultiDiscreteArray":
            return MultiDiscrete(np.ravel(np.asarray(spec.num_values)))
        case "BoundedArray" if np.issubdtype(spec.dtype, np.floating):
            low, high = (
                np.broadcast_to(b, spec.shape).astype(np.float32) for b in (spec.minimum, spec.maximum)
            )
            return Box(low, high, dtype=np.float32)
        case "BoundedArray":
            low, high = (np.broadcast_to(b, spec.shape) for b in (spec.minimum, spec.maximum))
            return MultiDiscrete(np.ravel(high.astype(int) - low + 1))
    raise ValueError(f"actions must be discrete or bounded numbers, got {spec}")
