"""MiniGrid-Empty: a bare room with the goal in its lower right corner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Int32

from .cells import EMPTY, GOAL, WALL
from .task import TableTask, room


@dataclass(frozen=True)
class Empty(TableTask):
    """Walk to the goal. The agent starts in the corner opposite, or anywhere and in any direction."""

    size: int = 8
    random_start: bool = False

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8)
    elsewhere: ClassVar[tuple[int, ...]] = (EMPTY, WALL, GOAL)
    see_through_walls: ClassVar[bool] = True

    @property
    def max_steps(self) -> int:
        """Four times the cells."""
        return 4 * self.size**2

    def grids(self) -> Int32[np.ndarray, "1 size size"]:
        """One."""
        grid = room(self.size, self.size)
        grid[-2, -2] = GOAL
        return grid[None]

    def starts(self) -> list[tuple[int, int, int, int]]:
        """The corner, looking right; or every empty cell and direction."""
        if not self.random_start:
            return [(0, 1, 1, 0)]
        empty = np.argwhere(self.grids()[0] == EMPTY).tolist()
        return [(0, x, y, direction) for y, x in empty for direction in range(4)]


TASKS = {
    "MiniGrid-Empty-5x5-v0": Empty(5),
    "MiniGrid-Empty-6x6-v0": Empty(6),
    "MiniGrid-Empty-8x8-v0": Empty(8),
    "MiniGrid-Empty-16x16-v0": Empty(16),
    "MiniGrid-Empty-Random-5x5-v0": Empty(5, random_start=True),
    "MiniGrid-Empty-Random-6x6-v0": Empty(6, random_start=True),
}
