"""The programs of the compiled arena: lanes that step side by side, and the queue that fills them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Bool, Float, Int, UInt32

from ...algorithms.compiled import COMPILER_OPTIONS
from ...envs.env import MAX_EPISODE_STEPS, Env
from ...policies.distributions import distribution_of
from .bitmask_trees import Masked
from .pointer_trees import Linked

LANES = 256
"""Episodes that run side by side."""
TAKEN = LANES // 8
"""Episodes that begin at once: lanes that are done wait for as many others. To begin costs more than to step."""
BURST = 8
"""Steps before the lanes that are done are counted."""
MAX_JOBS = 1 << 14
"""Episodes in one call, of all its trees together."""
WATCHED = 16
"""Episodes that are observed at once."""

Forest: TypeAlias = Masked | Linked


class Lanes(NamedTuple):
    """What runs side by side."""

    job: Int[Array, " lanes"]
    """`MAX_JOBS` where there is none."""
    tree: Int[Array, " lanes"]
    key: UInt32[Array, "lanes 2"]
    env_state: Any
    observation: Float[Array, "lanes features"]
    time: Int[Array, " lanes"]
    total: Float[Array, " lanes"]
    done: Bool[Array, " lanes"]


def keys_of(base: Array, number: Int[Array, ""]) -> tuple[Array, Array]:
    """What is random in a numbered episode: at its start, and in its steps."""
    reset_key, step_key = jax.random.split(jax.random.fold_in(base, number))
    return reset_key, step_key


class _World(NamedTuple):
    """An environment many times, and what trees do in it."""

    env: Env
    forest: Forest
    answers: Array
    """What each leaf of each tree does, as the environment takes it ``[trees · leaves, ...]``."""

    @staticmethod
    def of(env: Env, forest: Forest) -> _World:
        distribution = distribution_of(env.action_space)
        actions = distribution.to_env(distribution.mode(jnp.asarray(forest.value)))
        return _World(env, forest, actions.reshape(-1, *actions.shape[2:]))

    @property
    def limit(self) -> int:
        """Steps of the longest episode."""
        return getattr(self.env, "max_episode_steps", None) or MAX_EPISODE_STEPS

    def begin(
        self, key: Array, job: Int[Array, " lanes"], tree: Int[Array, " lanes"], number: Int[Array, " lanes"]
    ) -> Lanes:
        """Numbered episodes."""
        base = jax.random.wrap_key_data(key)

        def one(number: Int[Array, ""]) -> tuple[Array, Any, Array]:
            reset_key, step_key = keys_of(base, number)
            return jax.random.key_data(step_key), *self.env.reset(reset_key)

        zero = jnp.zeros_like(job)
        return Lanes(job, tree, *jax.vmap(one)(number), zero, jnp.zeros(job.shape), zero > 0)

    def step(self, lanes: Lanes, held: tuple[Array, ...]) -> Lanes:
        """One step of each lane; of those that were done before it only the state moves on."""
        leaf = self.forest.apply(lanes.tree, held, lanes.observation)
        action = self.answers[lanes.tree * self.forest.value.shape[1] + leaf]
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
    """The lanes, what they hold of their trees, how many jobs they have taken, and what came of those."""

    taken: Int[Array, ""]
    lanes: Lanes
    held: tuple[Array, ...]
    returns: Float[Array, " jobs"]
    lengths: Int[Array, " jobs"]

    def written(self, where: Int[Array, " some"]) -> _Queue:
        """With the results of these lanes; of none where the number is no lane's."""
        job = self.lanes.job.at[where].get(mode="fill", fill_value=MAX_JOBS)
        total, time = (part.at[where].get(mode="clip") for part in (self.lanes.total, self.lanes.time))
        return self._replace(
            returns=self.returns.at[job].set(total, mode="drop"),
            lengths=self.lengths.at[job].set(time, mode="drop"),
        )


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function, compiler_options=COMPILER_OPTIONS)


@functools.lru_cache(maxsize=16)
def player(env: Env) -> Callable[..., tuple[Array, Array]]:
    """``run(forest, key, first, num_episodes, num_trees)``: returns and lengths of the jobs.

    The job of a tree in an episode has the number tree · num_episodes + episode.
    """

    def run(
        forest: Forest, key: Array, first: Array, num_episodes: Array, num_trees: Array
    ) -> tuple[Array, Array]:
        world, num_jobs = _World.of(env, forest), num_trees * num_episodes

        def begin(job: Int[Array, " lanes"]) -> Lanes:
            tree = jnp.minimum(job // num_episodes, num_trees - 1)
            return world.begin(key, job, tree, first + job % num_episodes)

        def fill(queue: _Queue) -> _Queue:
            free = jnp.nonzero(queue.lanes.done, size=TAKEN, fill_value=LANES)[0]
            job = queue.taken + jnp.arange(TAKEN)
            where = jnp.where(job < num_jobs, free, LANES)  # what goes to a lane beyond the last is dropped
            new = begin(job)
            return queue.written(where)._replace(
                taken=queue.taken + jnp.sum(where < LANES),
                lanes=jax.tree.map(lambda old, new: old.at[where].set(new, mode="drop"), queue.lanes, new),
                held=tuple(
                    old.at[..., where].set(new, mode="drop")
                    for old, new in zip(queue.held, forest.held(new.tree), strict=True)
                ),
            )

        def until_some_are_done(queue: _Queue) -> _Queue:
            enough = jnp.where(queue.taken < num_jobs, TAKEN, LANES)

            def burst(lanes: Lanes) -> Lanes:
                return jax.lax.fori_loop(0, BURST, lambda _, lanes: world.step(lanes, queue.held), lanes)

            lanes = jax.lax.while_loop(lambda lanes: jnp.sum(lanes.done) < enough, burst, queue.lanes)
            return queue._replace(lanes=lanes)

        nobody = jax.tree.map(jnp.zeros_like, begin(jnp.zeros(LANES, jnp.int32)))
        nobody = nobody._replace(job=jnp.full(LANES, MAX_JOBS), done=jnp.ones(LANES, bool))
        nothing = jnp.zeros(MAX_JOBS), jnp.zeros(MAX_JOBS, jnp.int32)
        queue = _Queue(jnp.int32(0), nobody, jax.tree.map(jnp.zeros_like, forest.held(nobody.tree)), *nothing)
        queue = jax.lax.while_loop(
            lambda queue: (queue.taken < num_jobs) | ~jnp.all(queue.lanes.done),
            lambda queue: until_some_are_done(fill(queue)),
            queue,
        )
        return queue.written(jnp.arange(LANES))[-2:]

    return _compiled(run)


@functools.lru_cache(maxsize=16)
def watcher(env: Env) -> Callable[..., tuple[Array, Array]]:
    """``watch(forest, key, first)``: what the first tree sees in so many episodes ``[time, episodes, features]``.

    And at which times an episode is still going on.
    """

    def watch(forest: Forest, key: Array, first: Array) -> tuple[Array, Array]:
        world, zero = _World.of(env, forest), jnp.zeros(WATCHED, jnp.int32)
        held = forest.held(zero)

        def one_step(carry: tuple[Lanes, Array, Array]) -> tuple[Lanes, Array, Array]:
            lanes, seen, running = carry
            now = jnp.max(lanes.time)
            seen, running = seen.at[now].set(lanes.observation), running.at[now].set(~lanes.done)
            return world.step(lanes, held), seen, running

        lanes = world.begin(key, zero, zero, first + jnp.arange(WATCHED))
        nothing = jnp.zeros((world.limit, *lanes.observation.shape)), jnp.zeros((world.limit, WATCHED), bool)
        return jax.lax.while_loop(lambda c: ~jnp.all(c[0].done), one_step, (lanes, *nothing))[1:]

    return _compiled(watch)
