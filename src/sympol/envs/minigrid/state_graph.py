"""All states and observations of a small MiniGrid world, found by exploring it.

The exploration takes every action from every start, until no state is new. The clock is left out: it can only end an
episode earlier. tests/parity shows that each of these steps is Farama's, so nothing else occurs there.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Float32, Int, Int32, PRNGKeyArray, UInt32

from ...compilation import call_in_batches
from ...types import Step
from ..capabilities import StateGraph
from .task import GridState, Task
from .view import View

BATCH = 512
"""Number of states observed together."""
MAX_STATES = 50_000
"""Largest number of states that are explored, which takes a second."""
MAX_NUMBERS = 1 << 26
"""Largest size of all observations, in numbers: 256 MiB."""

Arrays = TypeVar("Arrays")


class World(Protocol):
    """The parts of `sympol.envs.minigrid.core.MiniGrid` that an exploration needs."""

    @property
    def task(self) -> Task:
        """The task."""
        ...

    @property
    def view(self) -> View:
        """The view."""
        ...

    @property
    def rewards(self) -> Float32[np.ndarray, " times"]:
        """The reward of reaching the goal, at each time."""
        ...

    def start(self, draws: UInt32[Array, " draws"]) -> GridState:
        """See `sympol.envs.minigrid.core.MiniGrid.start`."""
        ...

    def observe(self, state: GridState) -> Float[Array, " features"]:
        """See `sympol.envs.minigrid.core.MiniGrid.observe`."""
        ...

    def step(self, key: PRNGKeyArray, state: GridState, action: Int[Array, ""]) -> tuple[GridState, Step]:
        """See `sympol.envs.env.Env.step`."""
        ...


class Exploration(NamedTuple):
    """S states in which one can act, and where each of the A actions leads, as NumPy arrays."""

    states: GridState  # [S, …], at time 0
    successor: Int32[np.ndarray, "states actions"]  # −1 where the episode terminates
    reaches_goal: Bool[np.ndarray, "states actions"]


@lru_cache(maxsize=4)
def state_graph(env: World) -> StateGraph | None:
    """List the states and transitions of a world.

    Args:
        env: The world.

    Returns:
        The graph, or None where the world is too large.
    """
    explored = explore(env)
    if explored is None:
        return None
    observations, observation_of = np.unique(observe_all(env, explored.states), axis=0, return_inverse=True)
    number = {key: i for i, key in enumerate(keys(explored.states))}
    return StateGraph(
        observations=observations,
        observation_of=observation_of.astype(np.int32),
        successor=explored.successor,
        reaches_goal=explored.reaches_goal,
        reward_at=env.rewards,
        index=lambda states: np.array([number[key] for key in keys(states)]),
    )


@lru_cache(maxsize=16)
def all_observations(env: World) -> Float32[np.ndarray, "observations features"] | None:
    """List the observations on which a policy may have to act.

    Args:
        env: The world.

    Returns:
        Each observation once, sorted; None where the world is too large.
    """
    explored = explore(env)
    if explored is None:
        return None
    observe, num_features = _observing(env), env.view.num_features
    found: set[bytes] = set()
    for rows in _batches(len(explored.successor)):
        seen = np.asarray(observe(at(explored.states, rows)))
        found.update(_as_bytes(np.packbits(seen.astype(bool), axis=1)))
        if len(found) * num_features > MAX_NUMBERS:
            return None
    bits = np.frombuffer(b"".join(sorted(found)), np.uint8).reshape(len(found), -1)
    observations = np.unpackbits(bits, axis=1, count=num_features).astype(np.float32)
    observations.setflags(write=False)
    return observations


def all_starts(env: World) -> GridState | None:
    """List the states that an episode can start from.

    Args:
        env: The world.

    Returns:
        The states, batched; None where they are too many to list.
    """
    draws = env.task.start_draws(MAX_STATES)
    return None if draws is None else call_in_batches(jax.jit(jax.vmap(env.start)), draws)


def explore(env: World, start: GridState | None = None) -> Exploration | None:
    """Find every state that can be reached from some states.

    Args:
        env: The world.
        start: The states to begin with, batched; by default all starts.

    Returns:
        The states and transitions, or None where there are more than `MAX_STATES`.
    """
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
        after, terminated, reaches_goal = call_in_batches(_expanding(env), frontier)
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
    return Exploration(known, np.concatenate(successors), np.concatenate(goals))


def observe_all(env: World, states: GridState) -> Float32[np.ndarray, "states features"]:
    """Compute the observations of many states.

    Args:
        env: The world.
        states: The states, batched.

    Returns:
        One observation for each.
    """
    return call_in_batches(_observing(env), states)


def keys(states: GridState) -> list[bytes]:
    """Return a key for each of many states; states that differ in time only share it.

    Args:
        states: The states, batched.

    Returns:
        The keys.
    """
    return _as_bytes(_rows(states))


def at(states: Arrays, rows: np.ndarray) -> Arrays:
    """Select some of many states.

    Args:
        states: Arrays with a row for each state.
        rows: The rows to select.

    Returns:
        The same arrays, of these rows.
    """
    return jax.tree.map(lambda x: x[rows], states)


@lru_cache(maxsize=16)
def _observing(env: World) -> Callable[..., Any]:
    return jax.jit(jax.vmap(env.observe))


@lru_cache(maxsize=16)
def _expanding(env: World) -> Callable[..., Any]:
    """Return a function that takes every action in each of many states.

    It returns the states after them, at time 0 again, whether they terminate, and whether they reach a goal.
    """

    def act(state: GridState, action: jax.Array) -> Any:
        after, step = env.step(jax.random.key(0), state, action)  # which draws nothing
        return after._replace(time=jnp.zeros_like(after.time)), step.terminated, step.reward > 0

    actions = jnp.arange(len(env.view.actions), dtype=jnp.int32)
    return jax.jit(jax.vmap(lambda state: jax.vmap(act, in_axes=(None, 0))(state, actions)))


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
