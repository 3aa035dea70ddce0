"""The spaces of an environment as a run's folder records them, so that reading the run opens no environment."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

if TYPE_CHECKING:
    from .spec import EnvSpec

_MOST = 100_000
"""The most numbers in a space that is recorded; beyond, or for another kind of space, the environment is made."""
_KINDS = "biuf"


class Recorded(NamedTuple):
    """The parts of an `EnvSpec` that can only be read off an environment.

    Attributes:
        observation_space: The observation space.
        action_space: The action space.
        max_episode_steps: The time limit, or None.
        integers: The positions of features that are whole numbers.
    """

    observation_space: gymnasium.Space
    action_space: gymnasium.Space
    max_episode_steps: int | None
    integers: tuple[int, ...]

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Recorded:
        """Read what `record` returned.

        Args:
            content: The table.

        Returns:
            The parts.

        Raises:
            ValueError: It has another form.
        """
        try:
            limit, integers = content["max_episode_steps"], content["integers"]
            if type(limit) is not int or limit < 0 or not all(type(i) is int and i >= 0 for i in integers):
                raise ValueError("max_episode_steps and integers must be whole numbers")
            observed, taken = (
                _Reader().space(content[f"{name}_space"]) for name in ("observation", "action")
            )
            return cls(observed, taken, limit or None, tuple(integers))
        except (AttributeError, AssertionError, KeyError, OverflowError, TypeError, ValueError) as error:
            raise ValueError(f"not the spaces of an environment ({error})") from error


def record(spec: EnvSpec) -> dict[str, Any]:
    """Return what to write into a run's folder.

    Args:
        spec: The environment.

    Returns:
        A table for TOML; empty for an environment in JAX, which is looked at without being opened, and where a space
        cannot be recorded.
    """
    if spec.env is not None:
        return {}
    spaces = {}
    for name in ("observation_space", "action_space"):
        space = getattr(spec, name)
        try:
            spaces[name] = _plain(space)
        except TypeError:
            return {}
        if _Reader().space(spaces[name]) != space:
            return {}
    limit = spec.max_episode_steps or 0  # TOML has no None
    return {**spaces, "max_episode_steps": limit, "integers": list(spec.features.integers)}


def _plain(space: gymnasium.Space) -> dict[str, Any]:
    """Return a space as TOML can hold it; raise TypeError where it cannot."""
    kind = type(space)
    plain: dict[str, Any] = {"kind": kind.__name__}
    if isinstance(space, Dict) and kind is Dict:
        if not all(type(key) is str for key in space.spaces):
            raise TypeError("keys must be text")
        return {**plain, "spaces": {key: _plain(part) for key, part in space.spaces.items()}}
    if isinstance(space, Tuple) and kind is Tuple:
        return {**plain, "spaces": [_plain(part) for part in space.spaces]}
    plain |= {"shape": list(space.shape or ()), "dtype": np.dtype(space.dtype).str}
    if math.prod(plain["shape"]) > _MOST:
        raise TypeError("too large")
    if isinstance(space, Box) and kind is Box:
        return {**plain, "low": _numbers(space.low), "high": _numbers(space.high)}
    if isinstance(space, Discrete) and kind is Discrete:
        return {**plain, "n": int(space.n), "start": int(space.start)}
    if isinstance(space, MultiDiscrete) and kind is MultiDiscrete:
        return {**plain, "n": _numbers(space.nvec), "start": _numbers(space.start)}
    if isinstance(space, MultiBinary) and kind is MultiBinary:
        return plain
    raise TypeError(f"{kind} cannot be recorded")


class _Reader:
    """Makes a space of what `_plain` wrote, in bounded memory."""

    def __init__(self) -> None:
        self._left = _MOST

    def space(self, plain: Mapping[str, Any]) -> gymnasium.Space:
        kind = plain["kind"]
        if kind == "Dict":  # whose constructor would sort the keys of a plain dictionary
            return Dict(OrderedDict((key, self.space(part)) for key, part in plain["spaces"].items()))
        if kind == "Tuple":
            return Tuple([self.space(part) for part in plain["spaces"]])
        shape, dtype = tuple(plain["shape"]), np.dtype(plain["dtype"])
        if dtype.kind not in _KINDS or not all(type(n) is int and n >= 0 for n in shape):
            raise ValueError(f"no space has the dtype {dtype} and the shape {shape}")
        self._left -= math.prod(shape) + 1
        if self._left < 0:
            raise ValueError(f"more than {_MOST:,} numbers")

        def array(name: str) -> np.ndarray:
            numbers = np.array(plain[name], dtype)
            return np.full(shape, numbers) if numbers.ndim == 0 else numbers.reshape(shape)

        match kind:
            case "Box":
                return Box(array("low"), array("high"), dtype=dtype.type)  # pyright: ignore[reportArgumentType]
            case "Discrete":
                return Discrete(int(plain["n"]), start=int(plain["start"]))
            case "MultiDiscrete":
                return MultiDiscrete(array("n"), dtype=dtype.type, start=array("start"))  # pyright: ignore[reportArgumentType]
            case "MultiBinary":
                return MultiBinary(shape if len(shape) != 1 else shape[0])
        raise ValueError(f"no space is called {kind!r}")


def _numbers(array: np.ndarray) -> Any:
    """Return the numbers of an array, or the only one that there is."""
    flat = np.ravel(array)
    return flat[0].item() if flat.size and (flat == flat[0]).all() else flat.tolist()
