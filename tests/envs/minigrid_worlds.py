"""The worlds of a MiniGrid task: the shortest way to the goal, and the way between Farama's environments and ours.

A `World` is the common tongue of the two: it can be read from and written into Farama's environments.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sympol.compilation import call_in_batches
from sympol.envs.capabilities import steps_to_goal
from sympol.envs.minigrid import MiniGrid, state_graph
from sympol.envs.minigrid.cells import EMPTY, KINDS, PORTABLE, bits
from sympol.envs.minigrid.core import IN_HAND
from sympol.envs.minigrid.state_graph import Exploration, explore, keys
from sympol.envs.minigrid.task import GridState
from sympol.types import Step


class World(NamedTuple):
    """A state without any convention of ours: arrays may have a leading batch axis."""

    cells: NDArray[np.int32]  # [height, width], codes as in sympol.envs.minigrid.cells
    position: NDArray[np.int32]  # x, y
    direction: NDArray[np.int32]
    load: NDArray[np.int32]  # the code of what is carried, 0 for nothing


def all_starts(env: MiniGrid) -> tuple[GridState, NDArray[np.float64]]:
    """Every start (batched) and its probability."""
    draws, states = env.task.start_draws(state_graph.MAX_STATES), state_graph.all_starts(env)
    if draws is None or states is None:
        raise ValueError(f"too many starts to list them: {env.task}")
    _, first, num_second = np.unique(draws[:, 0], return_inverse=True, return_counts=True)
    return states, 1 / len(num_second) / num_second[first]


def step_all(env: MiniGrid, states: GridState, actions: NDArray) -> tuple[GridState, Step]:
    """One step from each of many states; all of it NumPy's."""
    return call_in_batches(_stepping(env), (states, actions.astype(np.int32)))


def reachable(env: MiniGrid, start: GridState | None = None) -> Exploration:
    """What there is to reach from some states (batched), by default from all starts."""
    graph = explore(env, start)
    assert graph is not None, "too many states"
    return graph


def optimal_returns(env: MiniGrid, hosts: Iterable[gymnasium.Env]) -> NDArray[np.float64]:
    """The greatest return from where each of these Farama environments is now, at step 0, with ``env``'s actions."""
    states = states_of(env, [world_of(host) for host in hosts])
    graph = reachable(env, states)
    index = {key: i for i, key in enumerate(keys(graph.states))}
    steps = steps_to_goal(graph.successor, graph.reaches_goal)[[index[key] for key in keys(states)]]
    limit = env.max_episode_steps
    return np.array([1 - 0.9 * (n / limit) if n <= limit else 0.0 for n in steps.tolist()])


def worlds_of(env: MiniGrid, states: GridState) -> World:
    """Many states of ours as worlds, ``[S, …]``."""
    states = jax.tree.map(np.asarray, states)
    everything = env._grids[states.layout]
    num, height, width = everything.shape
    flat = everything.reshape(num, -1).copy()
    load = np.zeros(num, np.int32)
    for thing in range(states.places.shape[1]):
        place, code = states.places[:, thing], states.codes[:, thing]
        held = place == IN_HAND
        load[held] = code[held]
        flat[np.flatnonzero(~held), place[~held]] = code[~held]
    inner = slice(env._padding, -env._padding)
    y, x = np.divmod(states.position, width)
    position = np.stack([x, y], axis=1) - env._padding
    direction = np.asarray(states.direction)
    return World(flat.reshape(num, height, width)[:, inner, inner], position, direction, load)


def states_of(env: MiniGrid, worlds: Sequence[World]) -> GridState:
    """Worlds as states of ours (batched), at time 0: in the grid that differs least, the things where it does."""
    grids = env.task.grids()
    num_draws = jax.ShapeDtypeStruct((env.task.num_draws,), jnp.uint32)
    num_things = jax.eval_shape(env.task.start, num_draws).things.shape[0]
    states = []
    for world in worlds:
        layout = int((grids != world.cells).sum(axis=(1, 2)).argmin())
        there = np.argwhere(grids[layout] != world.cells)
        things = [(env.place(int(x), int(y)), int(world.cells[y, x])) for y, x in there]  # type: ignore[arg-type]
        things += [(IN_HAND, int(world.load))] if world.load else []
        things.sort(key=lambda thing: thing[1] & -thing[1])  # by object, as the tasks list them
        things += things[-1:] * (num_things - len(things))  # FourRooms' goal may lie in a gap
        places, codes = np.array(things, np.int32).reshape(-1, 2).T
        position = env.place(*world.position)  # type: ignore[arg-type]
        numbers = layout, position, world.direction, places, codes, 0
        states.append(GridState(*(np.asarray(number, np.int32) for number in numbers)))  # type: ignore[arg-type]
    return jax.tree.map(lambda *x: np.stack(x), *states)


def world_of(host: gymnasium.Env) -> World:
    """Read the state of one of Farama's environments."""
    farama: Any = host.unwrapped
    codes = [EMPTY if thing is None else _code(*thing.encode()) for thing in farama.grid.grid]
    return World(
        np.array(codes, np.int32).reshape(farama.height, farama.width),
        np.array(farama.agent_pos, np.int32),
        np.array(farama.agent_dir, np.int32),
        np.array(0 if farama.carrying is None else _code(*farama.carrying.encode()), np.int32),
    )


def load_world(host: gymnasium.Env, world: World, time: int = 0) -> None:
    """Write a state into one of Farama's environments, which must have been reset once."""
    farama: Any = host.unwrapped
    farama.grid.grid = [_object(code) for code in world.cells.ravel().tolist()]
    farama.agent_pos = tuple(world.position.tolist())
    farama.agent_dir = int(world.direction)
    farama.carrying = _object(int(world.load)) if world.load else None
    farama.step_count = time


@lru_cache
def _code(*encoded: int) -> int:
    """Farama's three numbers of a cell as a code."""
    return sum(1 << kind.start + number for kind, number in zip(KINDS.values(), encoded, strict=True))


@lru_cache
def _triple(code: int) -> tuple[int, ...]:
    return tuple(next(i for i, plane in enumerate(kind) if code >> plane & 1) for kind in KINDS.values())


def _object(code: int) -> Any:
    """An object that may be changed if it is a door, for nobody else has it."""
    from minigrid.core.world_object import WorldObj

    if code & (PORTABLE | bits("door")):
        return WorldObj.decode(*_triple(code))
    if code not in _SCENERY:
        _SCENERY[code] = WorldObj.decode(*_triple(code))
    return _SCENERY[code]


_SCENERY: dict[int, Any] = {}


@lru_cache(maxsize=16)
def _stepping(env: MiniGrid) -> Any:
    step = jax.vmap(env.step, in_axes=(None, 0, 0))
    return jax.jit(lambda states_and_actions: step(jax.random.key(0), *states_and_actions))
