"""The evaluator of a world so small that all of it is known (`sympol.envs.minigrid.reach`): episodes are looked up.

What a tree does is asked once for each observation that there is. An episode then is a walk through a table of where
each action leads. Where a walk comes by the same state again it goes round for ever, as nothing else is remembered:
it has earned nothing when its time is over, and need not be followed till then (Brent's algorithm finds that).

Episodes, returns and lengths are those of `JaxEvaluator`, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int, Int32

from ...envs.minigrid import MiniGrid, reach
from ...envs.spec import EnvSpec
from ...play import WORDS
from ...trees import DecisionTree
from .base import Evaluator, Purpose, Returns
from .jax import keys_of
from .packed_trees import StackedTrees, leaf_actions

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
    rewards: Float32[np.ndarray, " times"]
    """For coming to the goal, at each time up to the limit."""

    def walk(
        self, act: Int[np.ndarray, "policies observations"], starts: Int[np.ndarray, " starts"]
    ) -> Returns:
        """What each policy, an action for each observation, earns from each state, and in how many steps."""
        successor, limit = self.graph.successor, len(self.rewards) - 1
        job = np.arange(len(act) * len(starts))
        policy, state = np.repeat(np.arange(len(act)), len(starts)), np.tile(starts, len(act))
        returns, lengths = np.zeros(len(job), np.float32), np.full(len(job), limit, np.int32)
        mark = state
        for time in range(1, limit + 1):
            action = act[policy, self.sees[state]]
            after = successor[state, action]
            over = after < 0
            arrives = self.graph.reaches_goal[state[over], action[over]]
            lengths[job[over]], returns[job[over]] = time, np.where(arrives, self.rewards[time], 0)
            goes_on = ~over & (after != mark)
            job, policy, state, mark = job[goes_on], policy[goes_on], after[goes_on], mark[goes_on]
            if not job.size:
                break
            if time & (time - 1) == 0:
                mark = state
        shape = len(act), len(starts)
        return Returns(returns.reshape(shape), lengths.reshape(shape))

    def way(self, act: Int[np.ndarray, " observations"], start: int) -> list[int]:
        """The states in which a policy acts, from one on until the episode is over."""
        states = [start]
        while len(states) < len(self.rewards) - 1:
            after = int(self.graph.successor[states[-1], act[self.sees[states[-1]]]])
            if after < 0:
                break
            states.append(after)
        return states


@lru_cache(maxsize=4)
def world_of(env: Any) -> World | None:
    """All of it, or None where that is too much, or cannot be found out."""
    graph = reach.explore(env) if isinstance(env, MiniGrid) else None
    if graph is None:
        return None
    seen = reach.observe_all(env, graph.states)
    observations, sees = np.unique(seen, axis=0, return_inverse=True)
    number = {key: i for i, key in enumerate(reach.keys(graph.states))}
    return World(graph, observations, sees.astype(np.int32), number, env.rewards)


class TabularEvaluator(Evaluator):
    """See the module. For environments that have a `world_of` theirs."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert isinstance(spec.env, MiniGrid)
        world = world_of(spec.env)
        assert world is not None
        self._env, self.world = spec.env, world
        self._key = np.array([WORDS[purpose], seed], np.uint32)
        self._begun: dict[range, Int[np.ndarray, " episodes"]] = {}

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        starts, episode = np.unique(self.starts(episodes), return_inverse=True)
        rows = max(1, ASKED // len(self.world.observations))
        acts = (self._actions(trees[i : i + rows]) for i in range(0, len(trees), rows))
        parts = [self.world.walk(act, starts) for act in acts]
        return Returns(*(np.concatenate(part)[:, episode] for part in zip(*parts, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]:
        act = self._actions([tree])[0]
        ways = (self.world.way(act, start) for start in self.starts(episodes).tolist())
        return self.world.observations[self.world.sees[[state for way in ways for state in way]]]

    def starts(self, episodes: range) -> Int[np.ndarray, " episodes"]:
        """The state that each episode starts in."""
        if episodes not in self._begun:
            numbers = np.arange(episodes.start, episodes.stop, dtype=np.int32)
            begin = _beginning(self._env)
            keys = reach.keys(reach.in_batches(lambda rows: begin(self._key, rows), numbers))
            self._begun[episodes] = np.array([self.world.number[key] for key in keys])
        return self._begun[episodes]

    def _actions(self, trees: Sequence[DecisionTree]) -> Int[np.ndarray, "trees observations"]:
        """What each tree does on each observation."""
        packed = StackedTrees.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        shape = len(trees), len(self.world.observations)
        tree = np.repeat(np.arange(shape[0]), shape[1])
        node = packed.apply(tree, np.tile(self.world.observations, (shape[0], 1)))
        return leaf_actions(packed, self.spec)[tree, node].reshape(shape)


@lru_cache(maxsize=4)
def _beginning(env: MiniGrid) -> Callable[..., Any]:
    """The states that numbered episodes start in."""

    def begin(key: jax.Array, numbers: Int[jax.Array, " episodes"]) -> Any:
        base = jax.random.wrap_key_data(key)
        return jax.vmap(lambda number: env.reset(keys_of(base, number)[0])[0])(jnp.asarray(numbers))

    return jax.jit(begin)
