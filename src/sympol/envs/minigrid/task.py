"""The parts of a MiniGrid task: its grids, the starts of its episodes, and what can be seen there."""

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
    """The start of an episode; x counts cells from the left, y from the top, both from 0."""

    layout: Int[Array, ""]  # which of the task's grids
    position: Int[Array, " 2"]  # x, y of the agent
    direction: Int[Array, ""]  # 0 right, 1 down, 2 left, 3 up
    things: Int[Array, "things 3"]  # x, y and cell code of what differs from the grid, or can change


class GridState(NamedTuple):
    """The state of an episode. A place is an index into the padded grid, row after row."""

    layout: Int[Array, ""]
    position: Int[Array, ""]
    direction: Int[Array, ""]  # 0 right, 1 down, 2 left, 3 up
    places: Int[Array, " things"]
    codes: Int[Array, " things"]
    time: Int[Array, ""]


@dataclass(frozen=True)
class Task(ABC):
    """A family of grids. It is frozen and hashable; what takes time is computed on first use."""

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
        """The number of steps after which an episode is truncated."""

    @abstractmethod
    def grids(self) -> Int32[np.ndarray, "layouts height width"]:
        """Return the cells of each layout, without the things.

        Returns:
            Codes of cells.
        """

    @abstractmethod
    def start(self, draws: UInt32[Array, " num_draws"]) -> Start:
        """Make a start of random integers, distributed as Farama's.

        Args:
            draws: The integers.

        Returns:
            The start.
        """

    def start_draws(self, at_most: int) -> UInt32[np.ndarray, "starts num_draws"] | None:
        """List the random integers of every start. Each is as likely as others that follow the same integers in a row.

        Args:
            at_most: The most starts to list.

        Returns:
            One row for each start, or None where there are more.
        """
        return None


@dataclass(frozen=True)
class TableTask(Task):
    """A task with so few starts that they are listed, each as likely as any other, and without things."""

    num_draws: ClassVar[int] = 1

    @abstractmethod
    def starts(self) -> Sequence[tuple[int, int, int, int]]:
        """List the starts.

        Returns:
            Layout, x, y and direction of each.
        """

    @cached_property
    def _table(self) -> Int32[np.ndarray, "starts 4"]:
        return np.array(self.starts(), np.int32)

    def start(self, draws: UInt32[Array, " 1"]) -> Start:
        """Return the start of an index. See `Task.start`."""
        row = jnp.asarray(self._table)[choice(draws[0], len(self._table))]
        return Start(row[0], row[1:3], row[3], jnp.zeros((0, 3), jnp.int32))

    def start_draws(self, at_most: int) -> UInt32[np.ndarray, "starts 1"] | None:
        """List every index. See `Task.start_draws`."""
        num = len(self._table)
        return None if num > at_most else np.arange(num, dtype=np.uint32)[:, None]


def choice(draw: Draw, num: int) -> Int[Array, ""]:
    """Choose one of several numbers; the first are likelier, by less than num / 2³².

    Args:
        draw: A random integer.
        num: How many numbers there are.

    Returns:
        A number from 0 to num - 1.
    """
    return choices(draw, num)[0]


def choices(draw: Draw, *nums: int | Int[Array, ""]) -> list[Int[Array, ""]]:
    """Choose several numbers by one random integer, because drawing another costs more.

    All combinations are equally likely, up to their number / 2³².

    Args:
        draw: A random integer.
        nums: How many numbers there are for each choice.

    Returns:
        A number from 0 for each choice.
    """
    found = []
    for num in nums:
        num = jnp.asarray(num, jnp.uint32)
        found.append((draw % num).astype(jnp.int32))
        draw = draw // num
    return found


def besides(taken: Int[Array, ""], choice: Int[Array, ""]) -> Int[Array, ""]:
    """Turn a choice of one number fewer into one among all but a number.

    Args:
        taken: The number that is excluded.
        choice: A choice among one number fewer.

    Returns:
        The number.
    """
    return choice + (choice >= taken).astype(jnp.int32)


def room(width: int, height: int) -> Int32[np.ndarray, "height width"]:
    """Return an empty room within walls.

    Args:
        width: Cells from left to right, with the walls.
        height: Cells from top to bottom, with the walls.

    Returns:
        Codes of cells.
    """
    grid = np.full((height, width), EMPTY, np.int32)
    grid[[0, -1], :] = WALL
    grid[:, [0, -1]] = WALL
    return grid
