"""The arena of a world so small that all of it is known (`sympol.envs.minigrid.reach`): episodes are looked up.

What a tree does is asked once for each observation that there is. An episode then is a walk through a table of where
each action leads. Where a walk comes by the same state again it goes round for ever, as nothing else is remembered:
it has earned nothing when its time is over, and need not be followed till then (Brent's algorithm finds that).

Episodes, returns and lengths are those of `CompiledArena`, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int, Int32

from ..envs.minigrid import MiniGrid, reach
from ..envs.spec import EnvSpec
from ..play import WORDS
from ..trees import DecisionTree
from .arena import Arena, Played, Purpose
from .lanes import keys_of
from .packed import Packed, answers

ASKED = 1 << 16
"""Observations that trees are asked about in one go, those of each tree counted."""


class World(NamedTuple):
    """All of a small environment."""

    graph: reach.Graph
    observations: Float32[np.ndarray, "observations features"]
    """Each once."""
    sees: Int32[np.ndarray, " states"]
    """Which of them each state shows."""
    number: dict[bytes, int]
    """Of each state, by its key."""


@lru_cache(maxsize=4)
def world_of(env: Any) -> World | None:
    """All of it, or None where that is too much, or cannot be found out."""
    graph = reach.explore(env) if isinstance(env, MiniGrid) else None
    if graph is None:
        return None
    seen = reach.observe_all(env, graph.states)
    observations, sees = np.unique(seen, axis=0, return_inverse=True)
    number = {key: i for i, key in enumerate(reach.keys(graph.states))}
    return World(graph, observations, sees.astype(np.int32), number)


class TableArena(Arena):
    """See the module. For environments that have a `world_of` theirs."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert isinstance(spec.env, MiniGrid)
        world = world_of(spec.env)
        assert world is not None
        self._env, self._world = spec.env, world
        self._key = np.array([WORDS[purpose], seed], np.uint32)
        self._begun: dict[range, Int[np.ndarray, " episodes"]] = {}

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Played:
        starts, episode = np.unique(self._starts(episodes), return_inverse=True)
        rows = max(1, ASKED // len(self._world.observations))
        parts = [self._walk(trees[i : i + rows], starts) for i in range(0, len(trees), rows)]
        return Played(*(np.concatenate(part)[:, episode] for part in zip(*parts, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]:
        act, graph = self._actions([tree])[0][self._world.sees], self._world.graph
        steps = []
        for start in self._starts(episodes).tolist():
            state, time = start, 0
            while state >= 0 and time < self._env.max_episode_steps:
                steps.append(state)
                state, time = int(graph.successor[state, act[state]]), time + 1
        return self._world.observations[self._world.sees[steps]]

    def _starts(self, episodes: range) -> Int[np.ndarray, " episodes"]:
        """The state that each episode starts in."""
        if episodes not in self._begun:
            numbers = np.arange(episodes.start, episodes.stop, dtype=np.int32)
            begin = _beginning(self._env)
            keys = reach.keys(reach.in_batches(lambda rows: begin(self._key, rows), numbers))
            self._begun[episodes] = np.array([self._world.number[key] for key in keys])
        return self._begun[episodes]

    def _actions(self, trees: Sequence[DecisionTree]) -> Int[np.ndarray, "trees observations"]:
        """What each tree does on each observation."""
        packed = Packed.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        shape = len(trees), len(self._world.observations)
        tree = np.repeat(np.arange(shape[0]), shape[1])
        node = packed.apply(tree, np.tile(self._world.observations, (shape[0], 1)))
        return answers(packed, self.spec)[tree, node].reshape(shape)

    def _walk(self, trees: Sequence[DecisionTree], starts: Int[np.ndarray, " starts"]) -> Played:
        """Each tree from each start."""
        successor, reaches_goal = self._world.graph.successor, self._world.graph.reaches_goal
        limit, rewards, act = self._env.max_episode_steps, self._env.rewards, self._actions(trees)
        job = np.arange(len(trees) * len(starts))
        tree, state = np.repeat(np.arange(len(trees)), len(starts)), np.tile(starts, len(trees))
        returns, lengths = np.zeros(len(job), np.float32), np.full(len(job), limit, np.int32)
        mark = state
        for time in range(1, limit + 1):
            action = act[tree, self._world.sees[state]]
            after = successor[state, action]
            over = after < 0
            lengths[job[over]] = time
            returns[job[over]] = np.where(reaches_goal[state[over], action[over]], rewards[time], 0)
            goes_on = ~over & (after != mark)
            job, tree, state, mark = job[goes_on], tree[goes_on], after[goes_on], mark[goes_on]
            if not job.size:
                break
            if time & (time - 1) == 0:
                mark = state
        shape = len(trees), len(starts)
        return Played(returns.reshape(shape), lengths.reshape(shape))


@lru_cache(maxsize=4)
def _beginning(env: MiniGrid) -> Callable[..., Any]:
    """The states that numbered episodes start in."""

    def begin(key: jax.Array, numbers: Int[jax.Array, " episodes"]) -> Any:
        base = jax.random.wrap_key_data(key)
        return jax.vmap(lambda number: env.reset(keys_of(base, number)[0])[0])(jnp.asarray(numbers))

    return jax.jit(begin)
