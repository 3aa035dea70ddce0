"""All that can ever be seen in a small world, found in the environment itself.

From every start by every action, in batches of one shape, until no state is new. The clock is left out: what it can
do is end an episode earlier. tests/parity shows that each of these steps is Farama's, so nothing else occurs there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Int32

from ...compilation import require_no_fork

if TYPE_CHECKING:
    from .core import GridState, MiniGrid

BATCH = 512
"""States handled together, so that one shape is compiled."""
MAX_STATES = 50_000
"""With more of them a world is too large to explore: that takes a second."""
MAX_NUMBERS = 1 << 26
"""With more of them all observations take too much memory, of which this is 256 MiB."""

UNREACHABLE = np.iinfo(np.int32).max
"""Steps to what no way leads to."""

Arrays = TypeVar("Arrays")


class Graph(NamedTuple):
    """S states in which one can act, and where each of the A actions leads. All of it is NumPy's."""

    states: GridState  # [S, …], at time 0
    successor: Int32[np.ndarray, "states actions"]  # −1 where the episode terminates
    reaches_goal: Bool[np.ndarray, "states actions"]


@lru_cache(maxsize=16)
def all_observations(env: MiniGrid) -> Float32[np.ndarray, "observations features"] | None:
    """Every observation on which a policy may have to act, once, in order; None where the world is too large."""
    graph = explore(env)
    if graph is None:
        return None
    observe, num_features = _observing(env), env.view.num_features
    found: set[bytes] = set()
    for rows in _batches(len(graph.successor)):
        seen = np.asarray(observe(at(graph.states, rows)))
        found.update(_as_bytes(np.packbits(seen.astype(bool), axis=1)))
        if len(found) * num_features > MAX_NUMBERS:
            return None
    bits = np.frombuffer(b"".join(sorted(found)), np.uint8).reshape(len(found), -1)
    observations = np.unpackbits(bits, axis=1, count=num_features).astype(np.float32)
    observations.setflags(write=False)
    return observations


def all_starts(env: MiniGrid) -> GridState | None:
    """Every state that an episode can start from (batched), or None where they are too many to list."""
    draws = env.task.start_draws(MAX_STATES)
    return None if draws is None else in_batches(jax.jit(jax.vmap(env.start)), draws)


def explore(env: MiniGrid, start: GridState | None = None) -> Graph | None:
    """Every state that can be reached from these (batched), by default from all starts; None if they are too many."""
    start = all_starts(env) if start is None else start
    if start is None:
        return None
    frontier = _distinct(jax.tree.map(np.asarray, start)._replace(time=np.zeros_like(start.time)))
    index = {key: i for i, key in enumerate(keys(frontier))}
    states, successors, goals = [], [], []
    while len(frontier.time):
        num_known = len(index)
        if num_known > MAX_STATES:
            return None
        after, terminated, reaches_goal = in_batches(_expanding(env), frontier)
        after = jax.tree.map(_one_after_another, after)
        goes_on = np.flatnonzero(~terminated)
        found = [index.setdefault(key, len(index)) for key in keys(at(after, goes_on))]
        successor = np.full(terminated.shape, -1, np.int32)
        successor.flat[goes_on] = found
        states.append(frontier)
        successors.append(successor)
        goals.append(reaches_goal)
        number, first = np.unique(np.array(found, np.int64), return_index=True)
        frontier = at(after, goes_on[first[number >= num_known]])
    known = jax.tree.map(lambda *parts: np.concatenate(parts), *states)
    return Graph(known, np.concatenate(successors), np.concatenate(goals))


def steps_to_goal(graph: Graph) -> Int32[np.ndarray, " states"]:
    """The least number of steps from each state, `UNREACHABLE` where the goal is out of reach."""
    steps = np.full(len(graph.successor), UNREACHABLE, np.int64)
    while True:
        via = np.where(graph.successor >= 0, steps[graph.successor], UNREACHABLE)
        nearer = np.minimum(np.where(graph.reaches_goal, 0, via).min(axis=1) + 1, UNREACHABLE)
        if (nearer == steps).all():
            return steps.astype(np.int32)
        steps = nearer


def observe_all(env: MiniGrid, states: GridState) -> Float32[np.ndarray, "states features"]:
    """The observation of each of many states."""
    return in_batches(_observing(env), states)


def keys(states: GridState) -> list[bytes]:
    """Something to look each of many states up by; the time does not count."""
    return _as_bytes(_rows(states))


def at(states: Arrays, rows: np.ndarray) -> Arrays:
    """Some of many states."""
    return jax.tree.map(lambda x: x[rows], states)


@lru_cache(maxsize=16)
def _observing(env: MiniGrid) -> Callable[..., Any]:
    return jax.jit(jax.vmap(env.observe))


@lru_cache(maxsize=16)
def _expanding(env: MiniGrid) -> Callable[..., Any]:
    """What each action leads to from each of many states, at time 0 again: state, terminated, goal reached."""

    def act(state: GridState, action: jax.Array) -> Any:
        after, step = env.step(jax.random.key(0), state, action)  # which draws nothing
        return after._replace(time=jnp.zeros_like(after.time)), step.terminated, step.reward > 0

    actions = jnp.arange(len(env.view.actions), dtype=jnp.int32)
    return jax.jit(jax.vmap(lambda state: jax.vmap(act, in_axes=(None, 0))(state, actions)))


def in_batches(program: Callable[[Any], Any], arrays: Any) -> Any:
    """Call a program on rows of arrays, always on as many; NumPy's arrays."""
    require_no_fork()
    num = len(jax.tree.leaves(arrays)[0])
    parts = [program(at(arrays, rows)) for rows in _batches(num)]
    return jax.tree.map(lambda *x: np.concatenate(x)[:num], *parts)


def _batches(num: int) -> Int32[np.ndarray, "batches states"]:
    """Rows in batches of one size; those that fill up the last one are the first ones again."""
    return np.resize(np.arange(num, dtype=np.int32), -(-num // BATCH) * BATCH).reshape(-1, BATCH)


def _one_after_another(x: np.ndarray) -> np.ndarray:
    """``[S, A, …]`` as ``[S · A, …]``."""
    return x.reshape(x.shape[0] * x.shape[1], *x.shape[2:])


def _rows(states: GridState) -> Int32[np.ndarray, "states numbers"]:
    columns = [states.layout, states.position, states.direction]
    return np.concatenate([np.stack(columns, axis=1), states.places, states.codes], axis=1)


def _distinct(states: GridState) -> GridState:
    return at(states, np.unique(_rows(states), axis=0, return_index=True)[1])


def _as_bytes(rows: np.ndarray) -> list[bytes]:
    rows = np.ascontiguousarray(rows)
    return rows.view(np.dtype((np.void, rows[:1].nbytes or 1))).ravel().tolist()
