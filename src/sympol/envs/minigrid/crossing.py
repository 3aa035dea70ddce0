"""MiniGrid-SimpleCrossing and LavaCrossing with one river: a straight line of wall or lava with one gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Int32

from .cells import EMPTY, GOAL, LAVA, UNSEEN, WALL
from .task import TableTask, room


@dataclass(frozen=True)
class SimpleCrossing(TableTask):
    """Find the gap, walk to the goal. The line runs across or down, in an even row or column."""

    size: int = 9

    obstacle: ClassVar[int] = WALL
    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL)
    see_through_walls: ClassVar[bool] = False

    @property
    def max_steps(self) -> int:
        """Four times the cells."""
        return 4 * self.size**2

    def grids(self) -> Int32[np.ndarray, "layouts size size"]:
        """One for every line and gap."""
        grids = []
        for line in range(2, self.size - 2, 2):
            for gap in range(1, self.size - 1):
                grid = room(self.size, self.size)
                grid[-2, -2] = GOAL
                grid[line, 1:-1] = self.obstacle
                grid[line, gap] = EMPTY
                grids += [grid, grid.T]  # goal and walls lie the same way across the diagonal
        return np.stack(grids)

    def starts(self) -> list[tuple[int, int, int, int]]:
        """The upper left corner, looking right."""
        return [(layout, 1, 1, 0) for layout in range(len(self.grids()))]


@dataclass(frozen=True)
class LavaCrossing(SimpleCrossing):
    """The same with lava, which ends the episode without reward."""

    obstacle: ClassVar[int] = LAVA
    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8, 9)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL, LAVA)


TASKS = {
    "MiniGrid-SimpleCrossingS9N1-v0": SimpleCrossing(9),
    "MiniGrid-LavaCrossingS9N1-v0": LavaCrossing(9),
}
