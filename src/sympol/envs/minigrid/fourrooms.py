"""MiniGrid-FourRooms: four rooms joined by a gap in each of the walls between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Int32, UInt32

from .cells import EMPTY, GOAL, UNSEEN, WALL
from .task import Start, Task, choice, choice_besides, room

SIZE = 19
MIDDLE = SIZE // 2


@dataclass(frozen=True)
class FourRooms(Task):
    """Walk from anywhere to a goal anywhere. Gaps and goal are things: there are 8⁴ · 260 · 259 layouts."""

    planes: ClassVar[tuple[int, ...]] = (0, 1, 2, 8)
    elsewhere: ClassVar[tuple[int, ...]] = (UNSEEN, EMPTY, WALL, GOAL)
    see_through_walls: ClassVar[bool] = False
    num_draws: ClassVar[int] = 7

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

    def start(self, draws: UInt32[Array, " 7"]) -> Start:
        """The four gaps, cell and direction of the agent, cell of the goal."""
        low, high = jnp.int32(1), jnp.int32(MIDDLE + 1)
        middle = jnp.int32(MIDDLE)
        gaps = jnp.stack(
            [
                jnp.stack([middle, low + choice(draws[0], MIDDLE - 1)]),
                jnp.stack([low + choice(draws[1], MIDDLE - 1), middle]),
                jnp.stack([high + choice(draws[2], MIDDLE - 1), middle]),
                jnp.stack([middle, high + choice(draws[3], MIDDLE - 1)]),
            ]
        )
        rooms = np.argwhere(self.grids()[0].T == EMPTY).astype(np.int32)  # x, y
        free = jnp.concatenate([gaps, jnp.asarray(rooms)])
        agent = choice(draws[4], len(free))
        goal = choice_besides(draws[5], len(free), agent)
        places = jnp.concatenate([gaps, free[goal][None]])
        codes = jnp.asarray([EMPTY] * len(gaps) + [GOAL], jnp.int32)
        things = jnp.concatenate([places, codes[:, None]], axis=1)
        return Start(jnp.int32(0), free[agent], choice(draws[6], 4), things)


TASKS = {"MiniGrid-FourRooms-v0": FourRooms()}
