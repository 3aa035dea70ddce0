"""The view of an agent in a MiniGrid, as flat named features; NumPy only."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, UInt8

from ...trees.groups import Group
from .cells import ACTIONS, ANYTHING, CARRIED, EMPTY, KINDS, PLANES

MAX_VIEW_SIZE = 31
"""A row of the view is kept in the bits of one int32 while what can be seen is computed."""


class Place(NamedTuple):
    """A cell of the view.

    Attributes:
        name: Its name.
        row: Its row, from the top.
        column: Its column, from the left.
        is_here: Whether it is the agent's own.
    """

    name: str
    row: int
    column: int
    is_here: bool


@dataclass(frozen=True)
class View:
    """A square in front of the agent, which stands in the middle of its lowest row and looks up.

    An observation is Farama's ``image[i, j]`` (column i from the left, row j from the top), one-hot as its
    ``OneHotPartialObsWrapper`` makes it, restricted to some planes and flattened in C order: feature
    ``(i · view_size + j) · P + p`` is plane ``planes[p]`` of that cell. Its numbers are 0 and 1 in float32. The
    SYMPOL paper scaled them to −1 and +1; with 0 and 1 the planes of one kind in one cell sum to one, and form a
    `Group`, which lets a tree say "front is lava". The agent's own cell shows what it carries. Missions, which
    are texts, are not observed, nor is the compass.

    Args:
        view_size: Cells along a side, odd.
        planes: Numbers of the planes, as in `cells.PLANES`: 0 to 10 the objects, 11 to 16 the colours, 17 to 19
            the states of a door. What is no door counts as open.
        actions: Numbers that Farama's package gives to the actions, as in `cells.ACTIONS`. The policy's action k
            is the k-th of them.
        elsewhere: What can occur in the cells around the agent, as `cells.cell` codes them.
        here: What can occur in the agent's own cell.

    Raises:
        ValueError: a view that is not odd or too small or large, planes or actions that do not exist or come
            twice.
    """

    view_size: int = 3
    planes: tuple[int, ...] = tuple(plane for plane in range(len(PLANES)) if PLANES[plane] != "agent")
    actions: tuple[int, ...] = tuple(range(len(ACTIONS)))
    elsewhere: tuple[int, ...] = field(default=ANYTHING, repr=False)
    here: tuple[int, ...] = field(default=(EMPTY, *CARRIED), repr=False)

    def __post_init__(self) -> None:
        """Make tuples of integers and check."""
        size = self.view_size
        if (
            isinstance(size, bool)
            or not isinstance(size, int)
            or size % 2 == 0
            or not 3 <= size <= MAX_VIEW_SIZE
        ):
            raise ValueError(
                f"view_size must be an odd number from 3 to {MAX_VIEW_SIZE}, got {size!r}; MiniGrid's own is 7, "
                "the paper's is 3"
            )
        object.__setattr__(self, "planes", _numbers("planes", self.planes, PLANES))
        object.__setattr__(self, "actions", _numbers("actions", self.actions, ACTIONS))

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """The cells, in the order of the features."""
        return tuple(self._places())

    @property
    def num_features(self) -> int:
        """Features of an observation, F."""
        return len(self.places) * len(self.planes)

    @cached_property
    def feature_names(self) -> tuple[str, ...]:
        """Names such as ``front is lava``, ``2 ahead, 1 left is wall``, ``front state is locked``."""
        return tuple(
            f"{_subject(place.name, _kind(plane))} is {PLANES[plane]}"
            for place in self.places
            for plane in self.planes
        )

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names such as ``turn left``."""
        return tuple(ACTIONS[action] for action in self.actions)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The features that are one-hot together: those of one kind, in one cell, if they leave nothing out."""
        return tuple(self._groups())

    @property
    def low(self) -> Float32[np.ndarray, " features"]:
        """Lowest value of each feature: 1 where it is always 1."""
        return self._bounds(np.bitwise_and)

    @property
    def high(self) -> Float32[np.ndarray, " features"]:
        """Highest value of each feature: 0 where it is always 0."""
        return self._bounds(np.bitwise_or)

    def encode(
        self, image: UInt8[np.ndarray, "*batch view view 3"]
    ) -> Float32[np.ndarray, "*batch features"]:
        """Turn Farama's image of the view into an observation.

        Args:
            image: Object, colour and state of each cell, or a batch of images.

        Returns:
            The observation, or a batch of them.
        """
        channels, values = self._questions
        shown = image[..., channels] == values
        return shown.reshape(*image.shape[:-3], -1).astype(np.float32)

    @cached_property
    def _questions(self) -> tuple[np.ndarray, np.ndarray]:
        """The channel of the image that each plane asks for, and the value."""
        kinds = [_kind(plane) for plane in self.planes]
        channels = [list(KINDS).index(kind) for kind in kinds]
        values = [plane - KINDS[kind].start for plane, kind in zip(self.planes, kinds, strict=True)]
        return np.array(channels), np.array(values, np.uint8)

    def _codes(self, place: Place) -> tuple[int, ...]:
        return self.here if place.is_here else self.elsewhere

    def _bounds(self, combine: np.ufunc) -> Float32[np.ndarray, " features"]:
        codes = np.array([combine.reduce(self._codes(place)) for place in self.places])
        return ((codes[:, None] >> np.array(self.planes)) & 1).ravel().astype(np.float32)

    def _places(self) -> Iterator[Place]:
        for column in range(self.view_size):
            for row in range(self.view_size):
                ahead, right = self.view_size - 1 - row, column - self.view_size // 2
                yield Place(_place_name(ahead, right), row, column, is_here=ahead == 0 and right == 0)

    def _groups(self) -> Iterator[Group]:
        for index, place in enumerate(self.places):
            occurring = int(np.bitwise_or.reduce(self._codes(place)))
            for kind, range_ in KINDS.items():
                chosen = [p for p, plane in enumerate(self.planes) if plane in range_]
                left_out = {p for p in range_ if occurring >> p & 1} - {self.planes[p] for p in chosen}
                if chosen and not left_out:
                    yield Group(
                        _subject(place.name, kind),
                        tuple(index * len(self.planes) + p for p in chosen),
                        tuple(PLANES[self.planes[p]] for p in chosen),
                        cell=(place.row, place.column),
                    )


def _kind(plane: int) -> str:
    return next(kind for kind, range_ in KINDS.items() if plane in range_)


def _subject(place: str, kind: str) -> str:
    return f"{place} {kind}" if kind else place


def _place_name(ahead: int, right: int) -> str:
    side = "left" if right < 0 else "right"
    match ahead, abs(right):
        case 0, 0:
            return "here"
        case 1, 0:
            return "front"
        case 1, 1:
            return f"front-{side}"
        case 0, 1:
            return side
        case 0, far:
            return f"{far} {side}"
        case _, 0:
            return f"{ahead} ahead"
        case _, far:
            return f"{ahead} ahead, {far} {side}"


def _numbers(what: str, given: Iterable[int], names: tuple[str, ...]) -> tuple[int, ...]:
    try:
        numbers = tuple(operator.index(number) for number in given)
    except TypeError:
        numbers = ()
    if not numbers or min(numbers) < 0 or max(numbers) >= len(names) or len(set(numbers)) < len(numbers):
        known = ", ".join(f"{number} {name}" for number, name in enumerate(names))
        raise ValueError(
            f"{what} must be one or more different numbers from 0 to {len(names) - 1}, got {given!r}; "
            f"they are {known}"
        )
    return numbers
