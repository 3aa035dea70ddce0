"""Observations and actions described in plain Python, such as ``{"level": (0, 10), "pump": ["off", "on"]}``."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from jaxtyping import Float32
from numpy.typing import NDArray

from ..trees.groups import Group
from .spaces import describe

Values: TypeAlias = tuple[float | None, float | None] | Sequence[Any] | range | type
"""The values of one thing: a range of numbers, a list of options, whole numbers, or ``bool``."""


@dataclass(frozen=True)
class Reading:
    """One thing that is observed: a number, or one of several options.

    Attributes:
        name: Its name.
        low: The lowest number.
        high: The highest number.
        integer: Whether it is a whole number.
        options: The options, by value, each with its position; None for a number.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    integer: bool = False
    options: Mapping[Any, int] | None = None

    @property
    def size(self) -> int:
        """The number of features that it becomes."""
        return 1 if self.options is None else len(self.options)


class Observations:
    """A row of features, and how it is read off a state.

    Args:
        readings: What is observed, in order.
    """

    def __init__(self, readings: Sequence[Reading]) -> None:
        self._parts: list[tuple[str, int, Mapping[Any, int] | None]] = []
        names, groups, integers, low, high = [], [], [], [], []
        for reading in readings:
            first = len(names)
            self._parts.append((reading.name, first, reading.options))
            if reading.options is None:
                names.append(reading.name)
                integers += [first] if reading.integer else []
            else:
                categories = tuple(map(str, reading.options))
                names += [f"{reading.name} is {category}" for category in categories]
                groups.append(Group(reading.name, tuple(range(first, len(names))), categories))
            low += [reading.low] * reading.size
            high += [reading.high] * reading.size
        self.names, self.groups, self.integers = tuple(names), tuple(groups), tuple(integers)
        self.space = _box(low, high)
        self._blank = [0.0] * len(names)

    def read(self, state: Any, where: str) -> Float32[np.ndarray, " features"]:
        """Read the features off a state.

        Args:
            state: A dictionary, or an object with attributes.
            where: What the state is, for messages.

        Returns:
            The features, in a new array.

        Raises:
            TypeError: A reading is missing or no number.
            ValueError: A reading is none of its options.
        """
        row, is_mapping = self._blank.copy(), isinstance(state, Mapping)
        for name, at, options in self._parts:
            try:
                value = state[name] if is_mapping else getattr(state, name)
            except (KeyError, AttributeError):
                raise TypeError(
                    f"{where} must have {name!r}, which is observed, got {describe(state)}"
                ) from None
            if options is not None:
                row[at + _position(name, options, value)] = 1.0
                continue
            try:
                row[at] = float(value)
            except (TypeError, ValueError):
                raise TypeError(f"{name} must be a number, got {describe(value)}") from None
        return np.array(row, np.float32)


class Actions:
    """The actions of a space, and what they mean to a simulator.

    Args:
        by_name: The values of each thing that is decided; the only name is empty where there is just one.
    """

    def __init__(self, by_name: Mapping[str, Reading]) -> None:
        parts = [*by_name.values()]
        self._names, self._alone = tuple(by_name), [*by_name] == [""]
        self._options = [list(part.options) for part in parts if part.options is not None]
        self.options: tuple[tuple[str, ...], ...] = ()
        self.space: gymnasium.Space
        if not self._options:
            self.space = _box([part.low for part in parts], [part.high for part in parts])
            self.names = () if self._alone else self._names
        elif self._alone:
            self.space, self.names = Discrete(len(self._options[0])), tuple(map(str, self._options[0]))
        else:
            self.space, self.names = MultiDiscrete([len(options) for options in self._options]), self._names
            self.options = tuple(tuple(map(str, options)) for options in self._options)

    def value(self, action: Any) -> Any:
        """Return an action as a simulator gets it.

        Args:
            action: An action of the space.

        Returns:
            The option or the number, or a dictionary of these by name.
        """
        if self._alone and self._options:
            return self._options[0][int(action)]
        flat: NDArray[Any] = np.ravel(action)
        chosen = (
            [options[int(i)] for options, i in zip(self._options, flat, strict=True)]
            if self._options
            else flat.tolist()
        )
        return chosen[0] if self._alone else dict(zip(self._names, chosen, strict=True))


def describe_observations(observations: Any) -> Observations:
    """Read a description of observations.

    Args:
        observations: The values of each reading, by name.

    Returns:
        The observations.

    Raises:
        ValueError: It cannot be understood; the message names the reading.
    """
    if not isinstance(observations, Mapping) or not observations:
        raise ValueError(
            f'observations must be a dictionary of names and values, such as {{"level": (0, 10), "pump": ["off", '
            f'"on"]}}, got {describe(observations)}'
        )
    return Observations(
        [_reading(_named(name, "observations"), values, "") for name, values in observations.items()]
    )


def describe_actions(actions: Any) -> Actions:
    """Read a description of actions.

    Args:
        actions: The values of the one thing that is decided, or of several by name.

    Returns:
        The actions.

    Raises:
        ValueError: It cannot be understood, or mixes ranges and options.
    """
    if not isinstance(actions, Mapping):
        return Actions({"": _reading("actions", actions, "actions: ")})
    if not actions:
        raise ValueError("actions must name at least one thing to decide, got an empty dictionary")
    parts = {_named(name, "actions"): _reading(name, values, "actions: ") for name, values in actions.items()}
    numbers = [name for name, part in parts.items() if part.options is None]
    if numbers and len(numbers) < len(parts):
        options = [name for name in parts if name not in numbers]
        raise ValueError(
            f"actions must all be ranges or all be lists of options, got ranges for {', '.join(numbers)} and options "
            f"for {', '.join(options)}: write a list such as [0, 0.25, 0.5, 0.75, 1] in place of a range, or a range "
            "(0, 1) that step divides in the middle in place of two options"
        )
    for name in numbers:
        if not (np.isfinite(parts[name].low) and np.isfinite(parts[name].high)):
            raise ValueError(f"actions: {name} must have two finite bounds, got {actions[name]!r}")
    return Actions(parts)


def _box(low: Sequence[float], high: Sequence[float]) -> Box:
    return Box(np.array(low, np.float32), np.array(high, np.float32))


def _reading(name: str, values: Any, where: str) -> Reading:
    if values is bool:
        return Reading(name, integer=True) if not where else Reading(name, options={False: 0, True: 1})
    if isinstance(values, range) and len(values):
        if where or values.step != 1:
            return Reading(name, options={value: i for i, value in enumerate(values)})
        return Reading(name, float(values[0]), float(values[-1]), integer=True)
    if isinstance(values, tuple) and len(values) == 2 and all(_is_bound(bound) for bound in values):
        low = -np.inf if values[0] is None else float(values[0])
        high = np.inf if values[1] is None else float(values[1])
        if not low < high:
            raise ValueError(f"{where}{name} must be a range (low, high) with low < high, got {values!r}")
        if where and not (np.isfinite(low) and np.isfinite(high)):
            raise ValueError(f"{where}{name} must have two finite bounds, got {values!r}")
        return Reading(name, low, high)
    if isinstance(values, list | tuple) and values and all(isinstance(value, Hashable) for value in values):
        options = {value: i for i, value in enumerate(values)}
        if len(options) == len(values) and len({*map(str, values)}) == len(values):
            return Reading(name, options=options)
        raise ValueError(f"{where}{name} must have options that differ, got {values!r}")
    raise ValueError(
        f'{where}{name} must have its values: a range (low, high), a list of options such as ["off", "on"], bool, or '
        f"range(11) for whole numbers from 0 to 10, got {describe(values)}"
    )


def _named(name: Any, where: str) -> str:
    if not isinstance(name, str) or not name.strip():
        raise ValueError(f"{where} must have names that are text, got {name!r}")
    return name


def _is_bound(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _position(name: str, options: Mapping[Any, int], value: Any) -> int:
    try:
        return options[value]
    except (KeyError, TypeError):
        there = ", ".join(map(repr, options))
        raise ValueError(f"{name} must be one of {there}, got {describe(value)}") from None
