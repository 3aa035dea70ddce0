"""MiniGrid-LavaGap: a column of lava with one gap between the agent and the goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Int32

from .cells import EMPTY, GOAL, LAVA, UNSEEN, WALL
from .task import TableTask, room


@dataclass(frozen=True)
class LavaGap(TableTask):
    """Find the gap, walk to the goal; lava ends the episode without reward."""

    size: int = 7

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8, 9)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL, LAVA)
    see_through_walls: ClassVar[bool] = False

    @property
    def max_steps(self) -> int:
        """Four times the cells."""
        return 4 * self.size**2

    def grids(self) -> Int32[np.ndarray, "layouts size size"]:
        """One for every place of the gap."""
        inner = range(1, self.size - 1)
        grids = []
        for x, y in ((x, y) for x in inner[1:-1] for y in inner):
            grid = room(self.size, self.size)
            grid[-2, -2] = GOAL
            grid[1:-1, x] = LAVA
            grid[y, x] = EMPTY
            grids.append(grid)
        return np.stack(grids)

    def starts(self) -> list[tuple[int, int, int, int]]:
        """The upper left corner, looking right."""
        return [(layout, 1, 1, 0) for layout in range(len(self.grids()))]


TASKS = {f"MiniGrid-LavaGapS{size}-v0": LavaGap(size) for size in (5, 6, 7)}
