"""The evaluator of environments whose states are all listed (`sympol.envs.capabilities.StateGraph`).

A tree is evaluated once on each observation there is. An episode is then a path through a table of transitions. A path
that reaches the same state again repeats itself for ever, because a tree has no memory: it earns nothing, and need not
be followed until its time is over (Brent's algorithm detects that).

Episodes, returns and lengths are those of `JaxEvaluator`, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int

from ...compilation import call_in_batches
from ...envs.capabilities import StateGraph
from ...envs.env import Env
from ...envs.spec import EnvSpec
from ...play import PURPOSE_TAGS
from ...trees import DecisionTree
from .base import Evaluator, Purpose, Returns
from .jax import keys_of
from .packed_trees import StackedTrees, leaf_actions

BATCH_SIZE = 1 << 16
"""Observations of all trees together that are evaluated at once."""


def play_table(
    graph: StateGraph, act: Int[np.ndarray, "policies observations"], starts: Int[np.ndarray, " starts"]
) -> Returns:
    """Play policies from states by a table of transitions.

    Args:
        graph: The states and transitions of the environment.
        act: The action of each policy on each observation ``[policies, observations]``.
        starts: The states ``[starts]`` from which each policy plays.

    Returns:
        Returns and lengths ``[policies, starts]``.
    """
    successor, limit = graph.successor, graph.max_steps
    job = np.arange(len(act) * len(starts))
    policy, state = np.repeat(np.arange(len(act)), len(starts)), np.tile(starts, len(act))
    returns, lengths = np.zeros(len(job), np.float32), np.full(len(job), limit, np.int32)
    mark = state
    for time in range(1, limit + 1):
        action = act[policy, graph.observation_of[state]]
        after = successor[state, action]
        over = after < 0
        arrives = graph.reaches_goal[state[over], action[over]]
        lengths[job[over]], returns[job[over]] = time, np.where(arrives, graph.reward_at[time], 0)
        continues = ~over & (after != mark)
        job, policy, state, mark = job[continues], policy[continues], after[continues], mark[continues]
        if not job.size:
            break
        if time & (time - 1) == 0:
            mark = state
    shape = len(act), len(starts)
    return Returns(returns.reshape(shape), lengths.reshape(shape))


def path(graph: StateGraph, act: Int[np.ndarray, " observations"], start: int) -> list[int]:
    """Return the states in which a policy acts.

    Args:
        graph: The states and transitions of the environment.
        act: The action of the policy on each observation ``[observations]``.
        start: The first state.

    Returns:
        The states of one episode, from the first on.
    """
    states = [start]
    while len(states) < graph.max_steps:
        after = int(graph.successor[states[-1], act[graph.observation_of[states[-1]]]])
        if after < 0:
            break
        states.append(after)
    return states


class TabularEvaluator(Evaluator):
    """An evaluator by table lookup, for environments that have a state graph."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        graph = spec.state_graph()
        assert spec.env is not None
        assert graph is not None
        self._env: Env = spec.env
        self.graph = graph
        self._key = np.array([PURPOSE_TAGS[purpose], seed], np.uint32)
        self._starts: dict[range, Int[np.ndarray, " episodes"]] = {}

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        starts, episode = np.unique(self.starts(episodes), return_inverse=True)
        rows = max(1, BATCH_SIZE // len(self.graph.observations))
        acts = (self._actions(trees[i : i + rows]) for i in range(0, len(trees), rows))
        parts = [play_table(self.graph, act, starts) for act in acts]
        return Returns(*(np.concatenate(part)[:, episode] for part in zip(*parts, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[np.ndarray, "steps features"]:
        act = self._actions([tree])[0]
        paths = (path(self.graph, act, start) for start in self.starts(episodes).tolist())
        return self.graph.observations[self.graph.observation_of[[state for one in paths for state in one]]]

    def starts(self, episodes: range) -> Int[np.ndarray, " episodes"]:
        """Return the first state of each episode.

        Args:
            episodes: Consecutive episode numbers.

        Returns:
            Numbers of states ``[episodes]``.
        """
        if episodes not in self._starts:
            numbers = np.arange(episodes.start, episodes.stop, dtype=np.int32)
            begin = _first_states(self._env)
            states = call_in_batches(lambda rows: begin(self._key, rows), numbers)
            self._starts[episodes] = self.graph.index(states)
        return self._starts[episodes]

    def _actions(self, trees: Sequence[DecisionTree]) -> Int[np.ndarray, "trees observations"]:
        """Return the action of each tree on each observation."""
        packed = StackedTrees.of(trees, len(trees), max(tree.n_nodes for tree in trees))
        shape = len(trees), len(self.graph.observations)
        tree = np.repeat(np.arange(shape[0]), shape[1])
        node = packed.apply(tree, np.tile(self.graph.observations, (shape[0], 1)))
        return leaf_actions(packed, self.spec)[tree, node].reshape(shape)


@lru_cache(maxsize=4)
def _first_states(env: Env) -> Callable[..., Any]:
    """Return a compiled function from episode numbers to first states."""

    def begin(key: jax.Array, numbers: Int[jax.Array, " episodes"]) -> Any:
        base = jax.random.wrap_key_data(key)
        return jax.vmap(lambda number: env.reset(keys_of(base, number)[0])[0])(jnp.asarray(numbers))

    return jax.jit(begin)
