"""The arena of an environment written in JAX: one compiled program with a queue of episodes.

Lanes step side by side. Where an episode has ended, its lane takes the next one from the queue, so that short
episodes wait for no long ones. Numbers of trees and of episodes are traced: a program is compiled once for trees of
up to 15, 31, 63, … nodes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Float32, Int, UInt32
from numpy import ndarray

from ..algos.state import tree_where
from ..algos.trainer import COMPILER_OPTIONS
from ..envs.env import MAX_EPISODE_STEPS, Env
from ..envs.spec import EnvSpec
from ..play import WORDS
from ..policies.distributions import distribution_of
from ..trees import DecisionTree
from ..types import Step
from .arena import Arena, Played, Purpose
from .packed import Packed

LANES = 512
"""Episodes that run side by side."""
MAX_JOBS = 1 << 14
"""Episodes in one call, of all its trees together."""
MAX_TREES = 1 << 8
"""Trees in one call."""
BURST = 8
"""Steps before the lanes that are done take other episodes."""
WATCHED = 16
"""Episodes that are observed at once."""
SMALLEST = 15
"""Nodes that even the smallest tree is padded to."""


class Lanes(NamedTuple):
    """What runs side by side."""

    job: Int[Array, " lanes"]
    key: UInt32[Array, "lanes 2"]
    env_state: Any
    observation: Float[Array, "lanes features"]
    time: Int[Array, " lanes"]
    total: Float[Array, " lanes"]
    done: Bool[Array, " lanes"]


class CompiledArena(Arena):
    """See the module."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert spec.env is not None
        self._env: Env = spec.env
        self._key = np.array([WORDS[purpose], seed], np.uint32)

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Played:
        num_nodes, at_once = _padded(trees), min(len(episodes), MAX_JOBS)
        run = _player(self._env, num_nodes)
        rows = min(MAX_TREES, MAX_JOBS // at_once)
        played: list[list[ndarray]] = []
        for i in range(0, len(trees), rows):
            some = trees[i : i + rows]
            packed, parts = Packed.of(some, MAX_TREES, num_nodes), []
            for j in range(0, len(episodes), at_once):
                numbers = episodes[j : j + at_once]
                results = run(packed, self._key, *map(np.int32, (numbers.start, len(numbers), len(some))))
                shape = (len(some), len(numbers))
                parts.append([np.asarray(part)[: shape[0] * shape[1]].reshape(shape) for part in results])
            played.append([np.concatenate(part, axis=1) for part in zip(*parts, strict=True)])
        return Played(*(np.concatenate(part) for part in zip(*played, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        num_nodes = _padded([tree])
        watch, packed = _watcher(self._env, num_nodes), Packed.of([tree], 1, num_nodes)
        seen = []
        for i in range(0, len(episodes), WATCHED):
            numbers = episodes[i : i + WATCHED]
            rows, running = map(np.asarray, watch(packed, self._key, np.int32(numbers.start)))
            seen.append(rows[running & (np.arange(WATCHED) < len(numbers))])
        return np.concatenate(seen)


def _padded(trees: Sequence[DecisionTree]) -> int:
    return max(SMALLEST, (1 << max(tree.n_nodes for tree in trees).bit_length()) - 1)


class _World(NamedTuple):
    """An environment many times, and what trees do in it."""

    env: Env
    limit: int

    def begin(self, base: Any, number: Int[Array, " lanes"]) -> tuple[Array, Any, Array]:
        """The key of each numbered episode's noise, its first state and observation."""

        def one(number: Int[Array, ""]) -> tuple[Array, Any, Array]:
            reset_key, step_key = jax.random.split(jax.random.fold_in(base, number))
            return jax.random.key_data(step_key), *self.env.reset(reset_key)

        return jax.vmap(one)(number)

    def actions(self, packed: Packed) -> Array:
        """What each leaf of each tree does, as the environment takes it."""
        distribution = distribution_of(self.env.action_space)
        return distribution.to_env(distribution.mode(jnp.asarray(packed.value)))

    def step(
        self, packed: Packed, actions: Array, tree: Int[Array, " lanes"], lanes: Lanes
    ) -> tuple[Any, Step]:
        """One step of each lane."""
        x = lanes.observation

        def down(_: Int[Array, ""], node: Int[Array, " lanes"]) -> Int[Array, " lanes"]:
            looked_at = jnp.take_along_axis(x, packed.feature[tree, node][:, None], axis=1)[:, 0]
            left = looked_at <= packed.threshold[tree, node]
            return jnp.where(left, packed.left[tree, node], packed.right[tree, node])

        leaf = jax.lax.fori_loop(0, packed.depth, down, jnp.zeros_like(tree))
        now = jax.vmap(jax.random.fold_in)(jax.random.wrap_key_data(lanes.key), lanes.time)
        return jax.vmap(self.env.step)(now, lanes.env_state, actions[tree, leaf])

    def after(self, lanes: Lanes, env_state: Any, step: Step) -> Lanes:
        """The lanes after a step; of those that were done before it only the state moves on."""
        time = jnp.where(lanes.done, lanes.time, lanes.time + 1)
        over = step.terminated | step.truncated | (time >= self.limit)
        return lanes._replace(
            env_state=env_state,
            observation=step.observation,
            time=time,
            total=lanes.total + jnp.where(lanes.done, 0.0, step.reward),
            done=lanes.done | over,
        )


def _world(env: Env) -> _World:
    return _World(env, getattr(env, "max_episode_steps", None) or MAX_EPISODE_STEPS)


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function, compiler_options=COMPILER_OPTIONS)


@functools.lru_cache(maxsize=16)
def _player(env: Env, num_nodes: int) -> Callable[..., tuple[Array, Array]]:
    """``run(packed, key, first, num_episodes, num_trees)``: returns and lengths of job tree · num_episodes + episode.

    Trees have up to ``num_nodes`` nodes; each number of nodes is a program of its own.
    """
    world = _world(env)

    def run(
        packed: Packed, key: Array, first: Array, num_episodes: Array, num_trees: Array
    ) -> tuple[Array, Array]:
        packed = jax.tree.map(jnp.asarray, packed)
        base, actions, num_jobs = (
            jax.random.wrap_key_data(key),
            world.actions(packed),
            num_trees * num_episodes,
        )

        def take(job: Int[Array, " lanes"]) -> Lanes:
            started = world.begin(base, first + job % num_episodes)
            zero = jnp.zeros(LANES, jnp.int32)
            return Lanes(job, *started, zero, jnp.zeros(LANES), job >= num_jobs)

        def one_step(_: Int[Array, ""], lanes: Lanes) -> Lanes:
            tree = jnp.minimum(lanes.job // num_episodes, num_trees - 1)
            return world.after(lanes, *world.step(packed, actions, tree, lanes))

        def burst(carry: tuple[Array, Lanes, Array, Array]) -> tuple[Array, Lanes, Array, Array]:
            queued, lanes, returns, lengths = carry
            lanes = jax.lax.fori_loop(0, BURST, one_step, lanes)
            where = jnp.where(lanes.done, lanes.job, MAX_JOBS)  # those that had no job write nowhere
            returns = returns.at[where].set(lanes.total, mode="drop")
            lengths = lengths.at[where].set(lanes.time, mode="drop")
            new = jnp.minimum(queued + jnp.cumsum(lanes.done) - 1, MAX_JOBS)
            lanes = tree_where(lanes.done, take(jnp.where(lanes.done, new, lanes.job)), lanes)
            return jnp.minimum(queued + jnp.sum(lanes.time == 0), MAX_JOBS), lanes, returns, lengths

        empty = jnp.zeros(MAX_JOBS), jnp.zeros(MAX_JOBS, jnp.int32)
        begun = (jnp.int32(LANES), take(jnp.arange(LANES)), *empty)
        return jax.lax.while_loop(lambda carry: jnp.any(carry[1].job < num_jobs), burst, begun)[2:]

    return _compiled(run)


@functools.lru_cache(maxsize=16)
def _watcher(env: Env, num_nodes: int) -> Callable[..., tuple[Array, Array]]:
    """``watch(packed, key, first)``: what the first tree sees in so many episodes ``[time, episodes, features]``.

    And at which times an episode is still going on.
    """
    world = _world(env)

    def watch(packed: Packed, key: Array, first: Array) -> tuple[Array, Array]:
        packed = jax.tree.map(jnp.asarray, packed)
        actions, tree = world.actions(packed), jnp.zeros(WATCHED, jnp.int32)

        def one_step(carry: tuple[Lanes, Array, Array]) -> tuple[Lanes, Array, Array]:
            lanes, seen, running = carry
            now = jnp.max(lanes.time)
            seen, running = seen.at[now].set(lanes.observation), running.at[now].set(~lanes.done)
            return world.after(lanes, *world.step(packed, actions, tree, lanes)), seen, running

        started = world.begin(jax.random.wrap_key_data(key), first + jnp.arange(WATCHED))
        zeros = jnp.zeros(WATCHED, jnp.int32), jnp.zeros(WATCHED), jnp.zeros(WATCHED, bool)
        lanes = Lanes(tree, *started, *zeros)
        nothing = jnp.zeros((world.limit, *lanes.observation.shape)), jnp.zeros((world.limit, WATCHED), bool)
        return jax.lax.while_loop(lambda c: ~jnp.all(c[0].done), one_step, (lanes, *nothing))[1:]

    return _compiled(watch)
