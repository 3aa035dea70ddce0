"""MiniGrid-FourRooms: four rooms joined by a gap in each of the walls between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int32, UInt32

from .cells import EMPTY, GOAL, UNSEEN, WALL
from .task import Start, Task, besides, choices, room

SIZE = 19
MIDDLE = SIZE // 2
ROOMS = np.array(
    [(x, y) for x in range(1, SIZE - 1) for y in range(1, SIZE - 1) if MIDDLE not in (x, y)], np.int32
)
"""x and y of the 256 cells within the rooms."""


@dataclass(frozen=True)
class FourRooms(Task):
    """Walk from anywhere to a goal anywhere. Gaps and goal are things: there are 8⁴ · 260 · 259 layouts."""

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL)
    see_through_walls: ClassVar[bool] = False
    num_draws: ClassVar[int] = 2

    @property
    def max_steps(self) -> int:
        """100."""
        return 100

    def grids(self) -> Int32[np.ndarray, "1 height width"]:
        """One, without gaps and goal."""
        grid = room(SIZE, SIZE)
        grid[MIDDLE, :] = WALL
        grid[:, MIDDLE] = WALL
        return grid[None]

    def start(self, draws: UInt32[Array, " 2"]) -> Start:
        """The four gaps, the direction of the agent; cells of agent and goal."""
        *gap, direction = choices(draws[0], *(MIDDLE - 1,) * 4, 4)
        low, middle, high = 1, jnp.int32(MIDDLE), MIDDLE + 1
        gaps = jnp.stack(
            [
                jnp.stack([middle, low + gap[0]]),
                jnp.stack([low + gap[1], middle]),
                jnp.stack([high + gap[2], middle]),
                jnp.stack([middle, high + gap[3]]),
            ]
        )
        num_free = len(gaps) + len(ROOMS)
        agent, goal = choices(draws[1], num_free, num_free - 1)
        goal = besides(agent, goal)
        places = jnp.concatenate([gaps, _free_cell(gaps, goal)[None]])
        codes = jnp.asarray([EMPTY] * len(gaps) + [GOAL], jnp.int32)
        things = jnp.concatenate([places, codes[:, None]], axis=1)
        return Start(jnp.int32(0), _free_cell(gaps, agent), direction, things)


def _free_cell(gaps: Int32[Array, "4 2"], index: Int32[Array, ""]) -> Int32[Array, " 2"]:
    """A gap, or a cell of a room."""
    cell = jnp.asarray(ROOMS)[jnp.maximum(index - len(gaps), 0)]
    for i, gap in enumerate(gaps):
        cell = jnp.where(index == i, gap, cell)
    return cell


TASKS = {"MiniGrid-FourRooms-v0": FourRooms()}
