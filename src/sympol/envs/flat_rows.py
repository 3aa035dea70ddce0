"""Write single observations into rows of flat features, without building an array for each.

`sympol.envs.spaces.Features.flatten` takes every form of observation that a space allows, and names what is wrong with
others; that costs ten microseconds. Most environments return exactly what their space says. For them, a space is turned
once into a function that checks so much and copies.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from gymnasium import Space
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple, flatdim
from jaxtyping import Float64
from numpy import ndarray

RowWriter: TypeAlias = Callable[[Any], bool]
"""A function that writes an observation into its row and returns True, or False where the observation is unusual."""

_EXACT = frozenset("efdbBhHiI?")
"""The types of arrays, as in ``dtype.char``, whose numbers float64 holds exactly."""
_INTEGERS = frozenset({int, np.int64, np.int32, np.int16, np.int8, np.uint8, np.uint16, np.uint32})


def row_writer(space: Space, row: Float64[ndarray, " features"]) -> RowWriter:
    """Return the function that writes the observations of a space into a row.

    Args:
        space: The observation space.
        row: The row, which has the features of the space, in the order of `Features`.

    Returns:
        The function.
    """
    match space:
        case Box() | MultiBinary():
            return _array_writer(space.shape or (), row, isinstance(space, Box))
        case Discrete():
            return _category_writer(int(space.start), int(space.n), row)
        case MultiDiscrete():
            return _categories_writer(space, row)
        case Dict():
            keys, parts = tuple(space.spaces), tuple(space.spaces.values())
            return _parts_writer(dict, keys, parts, row)
        case Tuple():
            return _parts_writer(tuple, tuple(range(len(space.spaces))), tuple(space.spaces), row)
    return lambda observation: False


def _array_writer(shape: tuple[int, ...], row: ndarray, real: bool) -> RowWriter:
    chars = _EXACT if real else _EXACT - set("efd")
    shaped = row.reshape(shape)  # the same memory

    def write(observation: Any) -> bool:
        if (
            type(observation) is not ndarray
            or observation.shape != shape
            or observation.dtype.char not in chars
        ):
            return False
        shaped[...] = observation
        return True

    return write


def _category_writer(start: int, n: int, row: ndarray) -> RowWriter:
    def write(observation: Any) -> bool:
        if type(observation) not in _INTEGERS or not 0 <= (category := int(observation) - start) < n:
            return False
        row.fill(0)
        row[category] = 1
        return True

    return write


def _categories_writer(space: MultiDiscrete, row: ndarray) -> RowWriter:
    shape, start, nvec = space.nvec.shape, space.start.ravel(), space.nvec.ravel()
    offsets = np.cumsum([0, *nvec[:-1]]) - start

    def write(observation: Any) -> bool:
        if (
            type(observation) is not ndarray
            or observation.shape != shape
            or observation.dtype.kind not in "iu"
        ):
            return False
        chosen = observation.reshape(-1).astype(np.int64)
        if (chosen < start).any() or (chosen >= start + nvec).any():
            return False
        row.fill(0)
        row[chosen + offsets] = 1
        return True

    return write


def _parts_writer(kind: type, keys: tuple[Any, ...], spaces: tuple[Space, ...], row: ndarray) -> RowWriter:
    ends = np.cumsum([flatdim(space) for space in spaces]).tolist()
    places = zip(keys, spaces, [0, *ends[:-1]], ends, strict=True)
    parts = [(key, row_writer(space, row[begin:end])) for key, space, begin, end in places]

    def write(observation: Any) -> bool:
        if not isinstance(observation, kind) or len(observation) != len(parts):
            return False
        try:
            for key, write_part in parts:
                if not write_part(observation[key]):
                    return False
        except KeyError:
            return False
        return True

    return write
