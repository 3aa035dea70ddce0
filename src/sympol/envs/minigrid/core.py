"""MiniGrid in JAX: the rules and the view of Farama's package, over integers that say what a cell shows.

What is drawn anew in every episode (`sympol.envs.minigrid.task`) is a row of a table of grids, and a few things
that lie elsewhere than in that grid or can change: keys, doors. A state is where those are, and where the agent is;
the grid itself never moves. It is padded with walls, as far as a view can reach, so that nothing asks whether a
place is inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Float32, Int, Int32, PRNGKeyArray, Shaped, UInt32

from ...trees.groups import Group
from ...types import Step
from ..capabilities import StateGraph
from . import cells
from .cells import BLOCKS_SIGHT, BLOCKS_WAY, EMPTY, PORTABLE, UNSEEN, WALL
from .state_graph import all_observations, state_graph
from .task import GridState, Task
from .view import View

IN_HAND = -1
"""The place of a thing that the agent carries."""
MAX_TABLE_SIZE = 7
"""Up to this view size, how sight spreads in a row is read from a table; that for the next has 2¹⁸ entries."""


@dataclass(frozen=True)
class MiniGrid:
    """A task seen through a view, step by step what Farama's package does; see `View` for the observation.

    A reward of 1 − 0.9 · steps / max_steps for reaching the goal, otherwise 0.
    """

    task: Task
    view: View

    @property
    def max_episode_steps(self) -> int:
        """The number of steps after which an episode is truncated."""
        return self.task.max_steps

    @property
    def feature_names(self) -> tuple[str, ...]:
        """Names such as ``front is lava``."""
        return self.view.feature_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names such as ``turn left``."""
        return self.view.action_names

    @property
    def groups(self) -> tuple[Group, ...]:
        """Features that are one-hot together: the object in a cell, its colour, its state."""
        return self.view.groups

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """A box of 0 or 1 for each feature; its bounds are equal where a feature never changes."""
        return gymnasium.spaces.Box(self.view.low, self.view.high, dtype=np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        """The view's actions, counted from 0."""
        return gymnasium.spaces.Discrete(len(self.view.actions))

    def reset(self, key: PRNGKeyArray) -> tuple[GridState, Float[Array, " features"]]:
        """Start an episode where the task may start. See `Env.reset`."""
        state = self.start(jax.random.bits(key, (self.task.num_draws,), jnp.uint32))
        return state, self.observe(state)

    def start(self, draws: UInt32[Array, " draws"]) -> GridState:
        """Return the start that the task makes of random integers.

        Args:
            draws: The integers.

        Returns:
            The state.
        """
        start = self.task.start(draws)
        x, y, codes = start.things[:, 0], start.things[:, 1], start.things[:, 2]
        position = self.place(start.position[0], start.position[1])
        return GridState(start.layout, position, start.direction, self.place(x, y), codes, jnp.int32(0))

    def step(self, key: PRNGKeyArray, state: GridState, action: Int[Array, ""]) -> tuple[GridState, Step]:
        """Turn, walk, or handle what is in front. See `Env.step`."""
        ahead = state.position + self._stride(state.direction)
        front = self._look(state, ahead[None])[0]
        turn = jnp.where(self._is(cells.LEFT, action), 3, 0) + jnp.where(self._is(cells.RIGHT, action), 1, 0)
        walks = self._is(cells.FORWARD, action) & (front & BLOCKS_WAY == 0)
        places, codes = self._handle(state, action, ahead, front)
        time = state.time + 1
        state = GridState(
            layout=state.layout,
            position=jnp.where(walks, ahead, state.position),
            direction=(state.direction + turn) & 3,
            places=places,
            codes=codes,
            time=time,
        )
        limit, rewards = self.max_episode_steps, jnp.asarray(self.rewards)
        reward = jnp.where(walks & _has(front, "goal"), lookup(rewards, jnp.minimum(time, limit)), 0)
        terminated = walks & _has(front, "goal", "lava")
        return state, Step(self.observe(state), reward, terminated, time >= limit)

    def observe(self, state: GridState) -> Float[Array, " features"]:
        """Return what the agent observes.

        Args:
            state: The state.

        Returns:
            The observation.
        """
        size = self.view.view_size
        column, row = np.divmod(np.arange(size * size, dtype=np.int32), np.int32(size))
        far, right = jnp.asarray(size - 1 - row), jnp.asarray(column - size // 2)
        forwards, sideways = self._stride(state.direction), self._stride((state.direction + 1) & 3)
        seen = self._look(state, state.position + far * forwards + right * sideways)
        if not self.task.see_through_walls:
            opaque = _bit(seen, BLOCKS_SIGHT).reshape(size, size)
            seen = jnp.where(visible(opaque).reshape(-1), seen, UNSEEN)
        is_here = np.array([place.is_here for place in self.view.places])
        seen = jnp.where(jnp.asarray(is_here), self._own_cell(state), seen)
        planes = jnp.asarray(self.view.planes, jnp.int32)
        return ((seen[:, None] >> planes[None, :]) & 1).astype(jnp.float32).reshape(-1)

    def all_observations(self) -> Float32[np.ndarray, "observations features"] | None:
        """List the observations. See `Env`.

        Returns:
            Every observation there can be, each once, or None where the world is too large.
        """
        return all_observations(self)

    def state_graph(self) -> StateGraph | None:
        """List the states. See `Env`.

        Returns:
            All states and transitions, or None where the world is too large.
        """
        return state_graph(self)

    def place(self, x: Int[Array, "*n"], y: Int[Array, "*n"]) -> Int[Array, "*n"]:
        """Return the index of a cell in the padded grid.

        Args:
            x: The column, from the left.
            y: The row, from the top.

        Returns:
            The index.
        """
        return (y + self._padding) * self._width + x + self._padding

    @cached_property
    def _grids(self) -> Int32[np.ndarray, "layouts height width"]:
        beyond = ((0, 0), *((self._padding, self._padding),) * 2)
        return np.pad(self.task.grids(), beyond, constant_values=WALL)

    @property
    def _padding(self) -> int:
        # the agent stands one cell within the grid and sees view_size − 1 ahead
        return self.view.view_size - 2

    @cached_property
    def _width(self) -> int:
        return self._grids.shape[2]

    @cached_property
    def rewards(self) -> Float32[np.ndarray, " times"]:
        """The reward of reaching the goal at each time, computed in float64 as by Farama, then rounded."""
        limit = self.max_episode_steps
        return np.array([1 - 0.9 * (time / limit) for time in range(limit + 1)], np.float32)

    def _is(self, number: int, action: Int[Array, ""]) -> Bool[Array, ""]:
        """Return whether the policy's action is the one that Farama's package gives this number."""
        if number not in self.view.actions:
            return jnp.bool_(False)
        return action == self.view.actions.index(number)

    def _stride(self, direction: Int[Array, ""]) -> Int[Array, ""]:
        """Return the distance in the padded grid of two cells that follow each other in a direction."""
        width = self._width
        return lookup(jnp.asarray([1, width, -1, -width], jnp.int32), direction)

    def _look(self, state: GridState, places: Int[Array, " n"]) -> Int[Array, " n"]:
        """Return the codes of what is in some places."""
        table = jnp.asarray(self._grids.ravel())
        found = lookup(table, state.layout * self._grids[0].size + places)
        for thing in range(state.places.shape[0]):
            found = jnp.where(places == state.places[thing], state.codes[thing], found)
        return found

    def _own_cell(self, state: GridState) -> Int[Array, ""]:
        load = _load(state)
        return jnp.where(load == 0, EMPTY, load)

    def _handle(
        self, state: GridState, action: Int[Array, ""], ahead: Int[Array, ""], front: Int[Array, ""]
    ) -> tuple[Int[Array, " things"], Int[Array, " things"]]:
        """Pick up, drop or toggle; return the places of things and their codes. A box keeps its content."""
        load, is_ahead = _load(state), state.places == ahead
        picks = self._is(cells.PICK_UP, action) & (load == 0) & (front & PORTABLE != 0)
        drops = self._is(cells.DROP, action) & (load != 0) & (front == EMPTY)
        places = jnp.where(is_ahead & picks, IN_HAND, state.places)
        places = jnp.where((state.places == IN_HAND) & drops, ahead, places)

        same_colour = (load ^ front) & cells.bits(*cells.COLOURS) == 0
        opens = ~_has(front, "open") & (_has(front, "closed") | (_has(load, "key") & same_colour))
        closes = _has(front, "open")
        door = front & ~cells.bits(*cells.STATES)
        door = jnp.where(
            opens, door | cells.bits("open"), jnp.where(closes, door | cells.bits("closed"), front)
        )
        toggles = self._is(cells.TOGGLE, action) & _has(front, "door")
        return places, jnp.where(is_ahead & toggles, door, state.codes)


def visible(opaque: Bool[Array, "size size"]) -> Bool[Array, "size size"]:
    """Return the cells of a view that are seen from the middle of its lowest row; the first axis is the column.

    Farama's rule, row by row upwards, see `_see_row`.
    """
    size = opaque.shape[0]
    column = jnp.arange(size, dtype=jnp.int32)[:, None]
    clear_rows = jnp.sum(jnp.where(opaque, 0, 1 << column), axis=0)
    is_looked_up = size <= MAX_TABLE_SIZE

    def see_row(reached: Int[Array, ""], clear: Int[Array, ""]) -> tuple[Int[Array, ""], Int[Array, ""]]:
        if not is_looked_up:
            return _see_row(reached, clear, size)
        found = lookup(jnp.asarray(_row_table(size)), reached << size | clear)
        return found >> size, found & ((1 << size) - 1)

    start = jnp.int32(1 << (size // 2))
    _, rows = jax.lax.scan(see_row, start, clear_rows, reverse=True, unroll=is_looked_up)
    return (rows[None, :] >> column) & 1 != 0


@lru_cache
def _row_table(size: int) -> Int32[np.ndarray, " entries"]:
    """`_see_row` for all rows there are, as ``above << size | seen`` at ``reached << size | clear``."""
    reached, clear = np.divmod(np.arange(1 << 2 * size, dtype=np.int32), np.int32(1 << size))
    above, seen = _see_row(reached, clear, size)
    return above << size | seen


def _see_row(reached: Any, clear: Any, size: int) -> tuple[Any, Any]:
    """Spread sight in a row from the cells reached from below; return those reached above, and all that are seen.

    It goes sideways until something opaque, first to the right, then to the left; from every cell that it leaves
    that way it reaches the cell above and the one above its goal. A row has a bit for each column, in NumPy's or
    JAX's integers.
    """
    seen, everything = reached, (1 << size) - 1
    distances = [1 << i for i in range((size - 1).bit_length())]
    way = clear << 1 & everything  # into which cell one comes from its left
    for distance in distances:  # twice as far each time
        seen = seen | way & seen << distance
        way = way & way << distance
    leaves = seen & clear & everything >> 1
    above = leaves | leaves << 1
    way = clear >> 1
    for distance in distances:
        seen = seen | way & seen >> distance
        way = way & way >> distance
    leaves = seen & clear & ~1
    return above | leaves | leaves >> 1, seen


def lookup(table: Shaped[Array, " n"], index: Int[Array, "*m"]) -> Shaped[Array, "*m"]:
    """Return entries of a table.

    Args:
        table: The table.
        index: Indices, which must be in range.

    Returns:
        The entries.
    """
    return table.at[index].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _load(state: GridState) -> Int[Array, ""]:
    """Return the code of what the agent carries, 0 for nothing."""
    return jnp.sum(jnp.where(state.places == IN_HAND, state.codes, 0))


def _has(code: Int[Array, ""], *planes: str) -> Bool[Array, ""]:
    return _bit(code, cells.bits(*planes))


def _bit(code: Int[Array, "*n"], mask: int) -> Bool[Array, "*n"]:
    return code & mask != 0
