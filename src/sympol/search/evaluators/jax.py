"""Evaluator of environments written in JAX: one compiled program with a queue of episodes.

A batch of episodes is stepped together. Slots whose episode has ended take the next ones from the queue,
several at a time, so that short episodes do not wait for long ones. Numbers of trees, of episodes and of nodes
are traced: one program plays all trees of up to 32 leaves, others those of up to 127 nodes, 255, ….
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Float32, Int, UInt32
from numpy import ndarray

from ...algorithms.compiled import COMPILER_OPTIONS
from ...compilation import require_no_fork
from ...envs.env import MAX_EPISODE_STEPS, Env
from ...envs.spec import EnvSpec
from ...play import PURPOSE_TAGS
from ...policies.distributions import distribution_of
from ...trees import DecisionTree
from .base import Evaluator, Purpose, Returns
from .packed_trees import MAX_LEAVES, BitmaskTrees, PointerTrees, StackedTrees

BATCH_SIZE = 256
"""Episodes that run side by side."""
REFILL = BATCH_SIZE // 8
"""Episodes that begin together: finished lanes wait until there are so many, as a reset costs more than a step."""
UNROLL = 8
"""Steps after which finished lanes are counted."""
MAX_JOBS = 1 << 14
"""Episodes in one call, of all its trees together."""
OBSERVED_AT_ONCE = 16
"""Episodes that are observed at once."""

PackedTrees: TypeAlias = BitmaskTrees | PointerTrees


class RolloutBatch(NamedTuple):
    """The episodes that are stepped together, one per lane."""

    job: Int[Array, " lanes"]
    """The number of the job; `MAX_JOBS` where there is none."""
    tree: Int[Array, " lanes"]
    key: UInt32[Array, "lanes 2"]
    env_state: Any
    observation: Float[Array, "lanes features"]
    time: Int[Array, " lanes"]
    total: Float[Array, " lanes"]
    done: Bool[Array, " lanes"]


def keys_of(base: Array, number: Int[Array, ""]) -> tuple[Array, Array]:
    """Return the keys of a numbered episode.

    Args:
        base: The key of the evaluator.
        number: The number of the episode.

    Returns:
        A key for its start, and one for its steps.
    """
    reset_key, step_key = jax.random.split(jax.random.fold_in(base, number))
    return reset_key, step_key


class _Player(NamedTuple):
    """Many copies of an environment, and the trees that act in them."""

    env: Env
    forest: PackedTrees
    leaf_actions: Array
    """The action of each leaf of each tree as the environment takes it ``[trees · leaves, ...]``."""

    @staticmethod
    def of(env: Env, forest: PackedTrees) -> _Player:
        distribution = distribution_of(env.action_space)
        actions = distribution.to_env(distribution.mode(jnp.asarray(forest.value)))
        return _Player(env, forest, actions.reshape(-1, *actions.shape[2:]))

    @property
    def limit(self) -> int:
        """The number of steps of the longest episode."""
        return getattr(self.env, "max_episode_steps", None) or MAX_EPISODE_STEPS

    def begin(
        self, key: Array, job: Int[Array, " lanes"], tree: Int[Array, " lanes"], number: Int[Array, " lanes"]
    ) -> RolloutBatch:
        """Begin numbered episodes."""
        base = jax.random.wrap_key_data(key)

        def one(number: Int[Array, ""]) -> tuple[Array, Any, Array]:
            reset_key, step_key = keys_of(base, number)
            return jax.random.key_data(step_key), *self.env.reset(reset_key)

        zero = jnp.zeros_like(job)
        return RolloutBatch(job, tree, *jax.vmap(one)(number), zero, jnp.zeros(job.shape), zero > 0)

    def step(self, lanes: RolloutBatch, tree_slices: tuple[Array, ...]) -> RolloutBatch:
        """Step each lane; lanes that were finished before keep their time, return and flag."""
        leaf = self.forest.apply(lanes.tree, tree_slices, lanes.observation)
        action = self.leaf_actions[lanes.tree * self.forest.value.shape[1] + leaf]
        now = jax.vmap(jax.random.fold_in)(jax.random.wrap_key_data(lanes.key), lanes.time)
        env_state, step = jax.vmap(self.env.step)(now, lanes.env_state, action)
        time = jnp.where(lanes.done, lanes.time, lanes.time + 1)
        over = step.terminated | step.truncated | (time >= self.limit)
        return lanes._replace(
            env_state=env_state,
            observation=step.observation,
            time=time,
            total=lanes.total + jnp.where(lanes.done, 0.0, step.reward),
            done=lanes.done | over,
        )


class _Queue(NamedTuple):
    """The lanes, their trees, the number of jobs taken, and the results of the finished ones."""

    taken: Int[Array, ""]
    lanes: RolloutBatch
    tree_slices: tuple[Array, ...]
    returns: Float[Array, " jobs"]
    lengths: Int[Array, " jobs"]

    def written(self, where: Int[Array, " some"]) -> _Queue:
        """Write the results of some lanes; a number that is no lane's writes nothing."""
        job = self.lanes.job.at[where].get(mode="fill", fill_value=MAX_JOBS)
        total, time = (part.at[where].get(mode="clip") for part in (self.lanes.total, self.lanes.time))
        return self._replace(
            returns=self.returns.at[job].set(total, mode="drop"),
            lengths=self.lengths.at[job].set(time, mode="drop"),
        )


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function, compiler_options=COMPILER_OPTIONS)


@functools.lru_cache(maxsize=16)
def compile_play(env: Env) -> Callable[..., tuple[Array, Array]]:
    """Compile the program that plays many trees.

    Args:
        env: The environment.

    Returns:
        ``run(forest, key, first, num_episodes, num_trees)``, which returns the returns and lengths ``[jobs]``. The job
        of a tree in an episode has the number tree · num_episodes + episode.
    """

    def run(
        forest: PackedTrees, key: Array, first: Array, num_episodes: Array, num_trees: Array
    ) -> tuple[Array, Array]:
        world, num_jobs = _Player.of(env, forest), num_trees * num_episodes

        def begin(job: Int[Array, " lanes"]) -> RolloutBatch:
            tree = jnp.minimum(job // num_episodes, num_trees - 1)
            return world.begin(key, job, tree, first + job % num_episodes)

        def fill(queue: _Queue) -> _Queue:
            free = jnp.nonzero(queue.lanes.done, size=REFILL, fill_value=BATCH_SIZE)[0]
            job = queue.taken + jnp.arange(REFILL)
            where = jnp.where(
                job < num_jobs, free, BATCH_SIZE
            )  # writes to a lane beyond the last are dropped
            new = begin(job)
            return queue.written(where)._replace(
                taken=queue.taken + jnp.sum(where < BATCH_SIZE),
                lanes=jax.tree.map(lambda old, new: old.at[where].set(new, mode="drop"), queue.lanes, new),
                tree_slices=tuple(
                    old.at[..., where].set(new, mode="drop")
                    for old, new in zip(queue.tree_slices, forest.tree_slices(new.tree), strict=True)
                ),
            )

        def until_some_are_done(queue: _Queue) -> _Queue:
            enough = jnp.where(queue.taken < num_jobs, REFILL, BATCH_SIZE)

            def burst(lanes: RolloutBatch) -> RolloutBatch:
                return jax.lax.fori_loop(
                    0, UNROLL, lambda _, lanes: world.step(lanes, queue.tree_slices), lanes
                )

            lanes = jax.lax.while_loop(lambda lanes: jnp.sum(lanes.done) < enough, burst, queue.lanes)
            return queue._replace(lanes=lanes)

        nobody = jax.tree.map(jnp.zeros_like, begin(jnp.zeros(BATCH_SIZE, jnp.int32)))
        nobody = nobody._replace(job=jnp.full(BATCH_SIZE, MAX_JOBS), done=jnp.ones(BATCH_SIZE, bool))
        nothing = jnp.zeros(MAX_JOBS), jnp.zeros(MAX_JOBS, jnp.int32)
        queue = _Queue(
            jnp.int32(0), nobody, jax.tree.map(jnp.zeros_like, forest.tree_slices(nobody.tree)), *nothing
        )
        queue = jax.lax.while_loop(
            lambda queue: (queue.taken < num_jobs) | ~jnp.all(queue.lanes.done),
            lambda queue: until_some_are_done(fill(queue)),
            queue,
        )
        return queue.written(jnp.arange(BATCH_SIZE))[-2:]

    return _compiled(run)


@functools.lru_cache(maxsize=16)
def compile_observe(env: Env) -> Callable[..., tuple[Array, Array]]:
    """Compile the program that observes one tree.

    Args:
        env: The environment.

    Returns:
        ``observe(forest, key, first)``, which returns the observations ``[time, episodes, features]`` of the first
        tree in `OBSERVED_AT_ONCE` episodes, and at which times each is running ``[time, episodes]``.
    """

    def observe(forest: PackedTrees, key: Array, first: Array) -> tuple[Array, Array]:
        world, zero = _Player.of(env, forest), jnp.zeros(OBSERVED_AT_ONCE, jnp.int32)
        tree_slices = forest.tree_slices(zero)

        def one_step(carry: tuple[RolloutBatch, Array, Array]) -> tuple[RolloutBatch, Array, Array]:
            lanes, seen, running = carry
            now = jnp.max(lanes.time)
            seen, running = seen.at[now].set(lanes.observation), running.at[now].set(~lanes.done)
            return world.step(lanes, tree_slices), seen, running

        lanes = world.begin(key, zero, zero, first + jnp.arange(OBSERVED_AT_ONCE))
        nothing = (
            jnp.zeros((world.limit, *lanes.observation.shape)),
            jnp.zeros((world.limit, OBSERVED_AT_ONCE), bool),
        )
        return jax.lax.while_loop(lambda c: ~jnp.all(c[0].done), one_step, (lanes, *nothing))[1:]

    return _compiled(observe)


MAX_TREES = 1 << 8
"""Trees in one call."""


class JaxEvaluator(Evaluator):
    """An evaluator that plays episodes in a compiled program."""

    def __init__(self, spec: EnvSpec, seed: int, purpose: Purpose = "refine") -> None:
        super().__init__(spec, seed, purpose)
        assert spec.env is not None
        self._env: Env = spec.env
        self._key = np.array([PURPOSE_TAGS[purpose], seed], np.uint32)

    def _play(self, trees: Sequence[DecisionTree], episodes: range) -> Returns:
        require_no_fork()
        run, at_once = compile_play(self._env), min(len(episodes), MAX_JOBS)
        rows = min(MAX_TREES, MAX_JOBS // at_once)
        played: list[list[ndarray]] = []
        for i in range(0, len(trees), rows):
            some = trees[i : i + rows]
            forest, parts = _forest(some, MAX_TREES), []
            for j in range(0, len(episodes), at_once):
                numbers = episodes[j : j + at_once]
                results = run(forest, self._key, *map(np.int32, (numbers.start, len(numbers), len(some))))
                shape = (len(some), len(numbers))
                parts.append([np.asarray(part)[: shape[0] * shape[1]].reshape(shape) for part in results])
            played.append([np.concatenate(part, axis=1) for part in zip(*parts, strict=True)])
        return Returns(*(np.concatenate(part) for part in zip(*played, strict=True)))

    def _observe(self, tree: DecisionTree, episodes: range) -> Float32[ndarray, "steps features"]:
        require_no_fork()
        observe, forest = compile_observe(self._env), _forest([tree], 1)
        seen = []
        for i in range(0, len(episodes), OBSERVED_AT_ONCE):
            numbers = episodes[i : i + OBSERVED_AT_ONCE]
            rows, running = map(np.asarray, observe(forest, self._key, np.int32(numbers.start)))
            seen += [rows[running[:, k], k] for k in range(len(numbers))]
        return np.concatenate(seen)


def _forest(trees: Sequence[DecisionTree], num_trees: int) -> PackedTrees:
    if max(tree.n_leaves for tree in trees) <= MAX_LEAVES:
        return BitmaskTrees.of(trees, num_trees)
    num_nodes = (1 << max(tree.n_nodes for tree in trees).bit_length()) - 1
    return PointerTrees.of(StackedTrees.of(trees, num_trees, num_nodes))
