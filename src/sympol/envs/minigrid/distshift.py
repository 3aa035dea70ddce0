"""MiniGrid-DistShift: two strips of lava, whose places change between training and test.

``sympol/DistShift-Random-v0`` is our domain-randomised form, after the SYMPOL paper: the second strip in row 2 or
row 5, the goal on any empty cell but the agent's. Everything else is as in DistShift1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np
from jaxtyping import Int32

from .cells import EMPTY, GOAL, LAVA, WALL
from .task import TableTask, room

WIDTH, HEIGHT = 9, 7
START = (1, 1)
STRIP_ROWS = (2, 5)

Layout: TypeAlias = tuple[int, tuple[int, int]]
"""Row of the second strip, and x and y of the goal."""


def random_layouts() -> list[Layout]:
    """List the 56 layouts of the randomised task, each as likely as any other; half have the strip in row 2.

    Returns:
        The layouts.
    """
    return [
        (row, (x, y))
        for row in STRIP_ROWS
        for y, x in np.argwhere(_without_goal(row) == EMPTY).tolist()
        if (x, y) != START
    ]


@dataclass(frozen=True)
class DistShift(TableTask):
    """Walk around the lava to the goal; lava ends the episode without reward."""

    layouts: tuple[Layout, ...]

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8, 9)
    elsewhere: ClassVar[tuple[int, ...]] = (EMPTY, WALL, GOAL, LAVA)
    see_through_walls: ClassVar[bool] = True

    @property
    def max_steps(self) -> int:
        """Four times the cells."""
        return 4 * WIDTH * HEIGHT

    def grids(self) -> Int32[np.ndarray, "layouts height width"]:
        """One for every layout."""
        grids = []
        for row, (x, y) in self.layouts:
            grid = _without_goal(row)
            grid[y, x] = GOAL
            grids.append(grid)
        return np.stack(grids)

    def starts(self) -> list[tuple[int, int, int, int]]:
        """The upper left corner, looking right."""
        return [(layout, *START, 0) for layout in range(len(self.layouts))]


def _without_goal(strip_row: int) -> Int32[np.ndarray, "height width"]:
    grid = room(WIDTH, HEIGHT)
    grid[[1, strip_row], 3 : WIDTH - 3] = LAVA
    return grid


RANDOM = "sympol/DistShift-Random-v0"
TASKS = {
    "MiniGrid-DistShift1-v0": DistShift(((2, (WIDTH - 2, 1)),)),
    "MiniGrid-DistShift2-v0": DistShift(((5, (WIDTH - 2, 1)),)),
    RANDOM: DistShift(tuple(random_layouts())),
}
