"""MiniGrid-DoorKey: fetch the key, unlock the door, walk to the goal behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int32, UInt32

from .cells import EMPTY, FORWARD, GOAL, LEFT, PICK_UP, RIGHT, STATES, TOGGLE, UNSEEN, WALL, cell
from .task import Start, Task, besides, choices, room

KEY = cell("key", "yellow")
DOORS = tuple(cell("door", "yellow", state) for state in STATES)
LOCKED = DOORS[STATES.index("locked")]


@dataclass(frozen=True)
class DoorKey(Task):
    """A wall divides the room, with a locked door in it; agent and key are anywhere on its left."""

    size: int = 8

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 4, 5, 8, 17, 18, 19)
    actions: ClassVar[tuple[int, ...]] = (LEFT, RIGHT, FORWARD, PICK_UP, TOGGLE)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL, KEY, *DOORS)
    here: ClassVar[tuple[int, ...]] = (EMPTY, KEY)
    see_through_walls: ClassVar[bool] = False
    num_draws: ClassVar[int] = 2

    @property
    def max_steps(self) -> int:
        """Ten times the cells."""
        return 10 * self.size**2

    def grids(self) -> Int32[np.ndarray, "layouts size size"]:
        """One for every column of the wall; the door stands in it as a thing."""
        grids = []
        for column in range(2, self.size - 2):
            grid = room(self.size, self.size)
            grid[-2, -2] = GOAL
            grid[:, column] = WALL
            grids.append(grid)
        return np.stack(grids)

    def start(self, draws: UInt32[Array, " 2"]) -> Start:
        """Column of the wall, row of the door, direction of the agent; cells of agent and key."""
        rows = self.size - 2
        # the door is never in the lowest row
        layout, door_row, direction = choices(draws[0], self.size - 4, self.size - 3, 4)
        cells_on_left = (layout + 1) * rows
        agent, key = choices(draws[1], cells_on_left, cells_on_left - 1)
        key = besides(agent, key)
        things = [
            [layout + 2, 1 + door_row, jnp.int32(LOCKED)],
            [1 + key // rows, 1 + key % rows, jnp.int32(KEY)],
        ]
        position = jnp.stack([1 + agent // rows, 1 + agent % rows])
        return Start(layout, position, direction, jnp.stack([jnp.stack(thing) for thing in things]))

    def start_draws(self, at_most: int) -> UInt32[np.ndarray, "starts 2"] | None:
        """Every combination of the choices in `start`."""
        first = np.arange((self.size - 4) * (self.size - 3) * 4)
        cells_on_left = (first % (self.size - 4) + 1) * (self.size - 2)
        nums = cells_on_left * (cells_on_left - 1)
        if nums.sum() > at_most:
            return None
        second = np.concatenate([np.arange(num) for num in nums])
        return np.stack([np.repeat(first, nums), second], axis=1).astype(np.uint32)


TASKS = {f"MiniGrid-DoorKey-{size}x{size}-v0": DoorKey(size) for size in (5, 6, 8, 16)}
