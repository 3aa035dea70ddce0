"""The worlds of a MiniGrid task as a graph: every state that can be reached, and the shortest way to the goal.

Found with the environment in JAX, in batches; tests/parity/test_minigrid.py shows that each of these steps is
Farama's. A `World` is the common tongue of the two: it can be read from and written into Farama's environments.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from sympol.envs.minigrid import MiniGrid
from sympol.envs.minigrid.cells import COLOURS, KINDS, OBJECTS
from sympol.envs.minigrid.core import IN_HAND, GridState
from sympol.types import Step

BATCH = 512
"""States stepped together, so that one shape is compiled."""
UNREACHABLE = np.iinfo(np.int32).max


class World(NamedTuple):
    """A state without any convention of ours: arrays may have a leading batch axis."""

    cells: NDArray[np.int32]  # [height, width], codes as in sympol.envs.minigrid.cells
    position: NDArray[np.int32]  # x, y
    direction: NDArray[np.int32]
    load: NDArray[np.int32]  # the code of what is carried, 0 for nothing


class Graph(NamedTuple):
    """S states in which one can act, and where each of the A actions leads."""

    states: GridState  # NumPy, [S, …]
    observations: NDArray[np.float32]  # [S, F]
    successor: NDArray[np.int32]  # [S, A], −1 where the episode terminates
    reaches_goal: NDArray[np.bool_]  # [S, A]


def starts(env: MiniGrid, num: int = 20_000) -> GridState:
    """All the starts that this many resets found: all there are, with certainty for the small tasks."""
    state, _ = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), num))
    return _unique(jax.tree.map(np.asarray, state))


def step_all(env: MiniGrid, states: GridState, actions: NDArray) -> tuple[GridState, Step]:
    """One step from each of many states, in batches of one shape."""
    step = _compiled(env)
    num = len(actions)
    rows = np.resize(np.arange(num), -(-num // BATCH) * BATCH).reshape(-1, BATCH)
    parts = [step(jax.tree.map(lambda x, r=r: x[r], states), actions[r].astype(np.int32)) for r in rows]
    return jax.tree.map(lambda *x: np.concatenate(x)[:num], *parts)


def reachable(env: MiniGrid, start: GridState | None = None) -> Graph:
    """Explore from some states (batched), by default from all starts, at time 0 and without a time limit."""
    known = _unique(jax.tree.map(np.asarray, starts(env) if start is None else start))
    num_actions = len(env.view.actions)
    index = {row.tobytes(): i for i, row in enumerate(_rows(known))}
    frontier, observations, successors, goals = known, [], [], []
    while len(frontier.time):
        num = len(frontier.time)
        observations.append(observe_all(env, frontier))
        each = jax.tree.map(lambda x: np.repeat(x, num_actions, axis=0), frontier)
        after, step = step_all(env, each, np.tile(np.arange(num_actions), num))
        after = after._replace(time=np.zeros_like(after.time))
        fresh, successor = [], np.full(len(step.reward), -1)
        for i in np.flatnonzero(~np.asarray(step.terminated)):
            key = _rows(jax.tree.map(lambda x, i=i: x[i : i + 1], after))[0].tobytes()
            if key not in index:
                index[key] = len(index)
                fresh.append(i)
            successor[i] = index[key]
        successors.append(successor.reshape(num, num_actions))
        goals.append(np.asarray(step.reward > 0).reshape(num, num_actions))
        frontier = jax.tree.map(lambda x: x[np.array(fresh, int)], after)  # noqa: B023
        known = jax.tree.map(lambda a, b: np.concatenate([a, b]), known, frontier)
    return Graph(known, np.concatenate(observations), np.concatenate(successors), np.concatenate(goals))


def steps_to_goal(graph: Graph) -> NDArray[np.int32]:
    """The least number of steps from each state, `UNREACHABLE` where the goal is."""
    steps = np.full(len(graph.successor), UNREACHABLE, np.int64)
    while True:
        via = np.where(graph.successor >= 0, steps[graph.successor], UNREACHABLE)
        nearer = np.minimum(np.where(graph.reaches_goal, 0, via).min(axis=1) + 1, UNREACHABLE)
        if (nearer == steps).all():
            return steps.astype(np.int32)
        steps = nearer


def optimal_returns(env: MiniGrid, hosts: Iterable[gymnasium.Env]) -> NDArray[np.float64]:
    """The greatest return from where each of these Farama environments is now, at step 0, with ``env``'s actions."""
    worlds = [world_of(host) for host in hosts]
    states = jax.tree.map(lambda *x: np.stack(x), *[state_of(env, world) for world in worlds])
    graph = reachable(env, states)
    index = {row.tobytes(): i for i, row in enumerate(_rows(graph.states))}
    steps = steps_to_goal(graph)[[index[row.tobytes()] for row in _rows(states)]]
    limit = env.max_episode_steps
    return np.array([1 - 0.9 * (n / limit) if n <= limit else 0.0 for n in steps.tolist()])


def observe_all(env: MiniGrid, states: GridState) -> NDArray[np.float32]:
    """The observation of each of many states."""
    return np.asarray(jax.jit(jax.vmap(env.observe))(states))


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
    return World(flat.reshape(num, height, width)[:, inner, inner], position, states.direction, load)


def state_of(env: MiniGrid, world: World) -> GridState:
    """A world as a state of ours, at time 0: in the grid that differs from it least, the things where it does."""
    grids = env.task.grids()
    layout = int((grids != world.cells).sum(axis=(1, 2)).argmin())
    there = np.argwhere(grids[layout] != world.cells)
    things = [(int(x), int(y), int(world.cells[y, x])) for y, x in there]
    if world.load:
        things.append((IN_HAND, IN_HAND, int(world.load)))
    things.sort(key=lambda thing: thing[2] & -thing[2])  # by object, as the tasks list them
    table = np.array(things, np.int32).reshape(-1, 3)
    places = np.where(
        table[:, 0] == IN_HAND, IN_HAND, env.place(jnp.asarray(table[:, 0]), jnp.asarray(table[:, 1]))
    )
    position = env.place(*jnp.asarray(world.position, jnp.int32))
    numbers = layout, position, world.direction, places, table[:, 2], 0
    return GridState(*(np.asarray(number, np.int32) for number in numbers))


def world_of(host: gymnasium.Env) -> World:
    """Read the state of one of Farama's environments."""
    farama: Any = host.unwrapped
    load = 0 if farama.carrying is None else int(codes_of(np.array(farama.carrying.encode())))
    cells = codes_of(farama.grid.encode()).T
    return World(
        cells, np.asarray(farama.agent_pos, np.int32), np.int32(farama.agent_dir), np.asarray(load, np.int32)
    )


def load_world(host: gymnasium.Env, world: World, time: int = 0) -> None:
    """Write a state into one of Farama's environments, which must have been reset once."""
    from minigrid.core.world_object import WorldObj

    farama: Any = host.unwrapped
    objects = [
        None if code is None else WorldObj.decode(*code)
        for code in map(_triple, world.cells.ravel().tolist())
    ]
    farama.grid.grid = objects
    farama.agent_pos = tuple(world.position.tolist())
    farama.agent_dir = int(world.direction)
    farama.carrying = WorldObj.decode(*_triple(int(world.load))) if world.load else None
    farama.step_count = time


def codes_of(encoded: NDArray) -> NDArray[np.int32]:
    """Farama's three numbers of a cell, ``[*shape, 3]``, as codes."""
    starts = [kind.start for kind in KINDS.values()]
    return (1 << (encoded.astype(np.int32) + np.array(starts, np.int32))).sum(axis=-1).astype(np.int32)


def _triple(code: int) -> tuple[int, int, int]:
    what, colour, state = (
        next(i for i, plane in enumerate(kind) if code >> plane & 1) for kind in KINDS.values()
    )
    return what, colour, state


_PROGRAMS: dict[MiniGrid, Any] = {}


def _compiled(env: MiniGrid) -> Any:
    if env not in _PROGRAMS:
        step = jax.vmap(env.step, in_axes=(None, 0, 0))
        _PROGRAMS[env] = jax.jit(lambda states, actions: step(jax.random.key(0), states, actions))
    return _PROGRAMS[env]


def _rows(states: GridState) -> NDArray[np.int32]:
    """Everything but the time, a row each."""
    columns = [states.layout, states.position, states.direction]
    return np.concatenate([np.stack(columns, axis=1), states.places, states.codes], axis=1)


def _unique(states: GridState) -> GridState:
    _, first = np.unique(_rows(states), axis=0, return_index=True)
    return jax.tree.map(lambda x: x[first], states)


assert len(OBJECTS) + len(COLOURS) == KINDS["state"].start
