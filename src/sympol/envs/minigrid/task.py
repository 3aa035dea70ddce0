"""What a MiniGrid task is made of: its grids, where an episode starts in them, and what can be seen there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int, Int32, UInt32

from .cells import EMPTY, FORWARD, LEFT, RIGHT, WALL

Draw = UInt32[Array, ""]


class Start(NamedTuple):
    """How an episode starts: x counts cells from the left, y from the top, both from 0."""

    layout: Int[Array, ""]  # which of the task's grids
    position: Int[Array, " 2"]  # x, y of the agent
    direction: Int[Array, ""]  # 0 right, 1 down, 2 left, 3 up
    things: Int[Array, "things 3"]  # x, y and cell code of what differs from the grid, or can change


class GridState(NamedTuple):
    """Where everything is. A place is an index into the padded grid, row after row."""

    layout: Int[Array, ""]
    position: Int[Array, ""]
    direction: Int[Array, ""]  # 0 right, 1 down, 2 left, 3 up
    places: Int[Array, " things"]
    codes: Int[Array, " things"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class Task(ABC):
    """A family of grids. Frozen and hashable; whatever takes time is computed when it is first asked for."""

    planes: ClassVar[tuple[int, ...]]
    """The planes observed by default: those of the objects that occur."""
    elsewhere: ClassVar[tuple[int, ...]]
    """Every code that a cell of the view can have, other than the agent's own."""
    here: ClassVar[tuple[int, ...]] = (EMPTY,)
    """Every code that the agent's own cell can have."""
    actions: ClassVar[tuple[int, ...]] = (LEFT, RIGHT, FORWARD)
    """The actions by default, as Farama's package numbers them."""
    see_through_walls: ClassVar[bool]
    num_draws: ClassVar[int]
    """How many random integers a start is made of."""

    @property
    @abstractmethod
    def max_steps(self) -> int:
        """Where an episode is cut off."""

    @abstractmethod
    def grids(self) -> Int32[np.ndarray, "layouts height width"]:
        """The cells as they are where no thing is."""

    @abstractmethod
    def start(self, draws: UInt32[Array, " num_draws"]) -> Start:
        """Make a start out of random integers, distributed as Farama's."""

    def start_draws(self, at_most: int) -> UInt32[np.ndarray, "starts num_draws"] | None:
        """Random integers for every start there is, one row each, or None where there are more than ``at_most``.

        Each integer is as likely as the others that come after the same ones before it.
        """
        return None


@dataclass(frozen=True)
class TableTask(Task):
    """A task with so few starts that they are listed, each as likely as any other, and without things."""

    num_draws: ClassVar[int] = 1

    @abstractmethod
    def starts(self) -> Sequence[tuple[int, int, int, int]]:
        """Layout, x, y and direction of every start."""

    @cached_property
    def _table(self) -> Int32[np.ndarray, "starts 4"]:
        return np.array(self.starts(), np.int32)

    def start(self, draws: UInt32[Array, " 1"]) -> Start:
        """One index, one row."""
        row = jnp.asarray(self._table)[choice(draws[0], len(self._table))]
        return Start(row[0], row[1:3], row[3], jnp.zeros((0, 3), jnp.int32))

    def start_draws(self, at_most: int) -> UInt32[np.ndarray, "starts 1"] | None:
        """Every index."""
        num = len(self._table)
        return None if num > at_most else np.arange(num, dtype=np.uint32)[:, None]


def choice(draw: Draw, num: int) -> Int[Array, ""]:
    """One of ``num`` numbers from 0. The first ones are likelier, by less than num / 2³²."""
    return choices(draw, num)[0]


def choices(draw: Draw, *nums: int | Int[Array, ""]) -> list[Int[Array, ""]]:
    """One out of each of several numbers from 0, out of one random integer: drawing another costs more.

    All combinations are equally likely, but for less than their number / 2³².
    """
    found = []
    for num in nums:
        num = jnp.asarray(num, jnp.uint32)
        found.append((draw % num).astype(jnp.int32))
        draw = draw // num
    return found


def besides(taken: Int[Array, ""], choice: Int[Array, ""]) -> Int[Array, ""]:
    """Turn a choice of one number fewer into one among all but the one taken."""
    return choice + (choice >= taken).astype(jnp.int32)


def room(width: int, height: int) -> Int32[np.ndarray, "height width"]:
    """An empty room within walls."""
    grid = np.full((height, width), EMPTY, np.int32)
    grid[[0, -1], :] = WALL
    grid[:, [0, -1]] = WALL
    return grid
