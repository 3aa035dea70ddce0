"""MiniGrid in JAX against Farama's package: no mismatch, in any state that can be reached."""

from __future__ import annotations

import time
from typing import Any

import jax
import numpy as np
import pytest

from sympol.envs.minigrid import make, make_host
from tests.envs.minigrid_worlds import (
    World,
    load_world,
    reachable,
    step_all,
    world_of,
    worlds_of,
)

FIVE = (
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
)
RANDOM = "sympol/DistShift-Random-v0"
ALL_ACTIONS = tuple(range(7))


def assert_steps_equal(env_id: str, num: int | None = None, **options: Any) -> int:
    """Every reachable state (or ``num`` of them) by every action."""
    env, host = make(env_id, **options), make_host(env_id, **options)
    graph = reachable(env)
    num_states, num_actions = graph.successor.shape
    rng = np.random.default_rng(0)
    rows = np.arange(num_states) if num is None else rng.choice(num_states, num, replace=False)
    rows, actions = np.repeat(rows, num_actions), np.tile(np.arange(num_actions), len(rows))
    limit = env.max_episode_steps
    times = np.choose(np.arange(len(rows)) % 3, [0, rng.integers(limit, size=len(rows)), limit - 1])

    before = jax.tree.map(lambda x: x[rows], graph.states)._replace(time=times.astype(np.int32))
    after, ours = step_all(env, before, actions)
    worlds_before, worlds_after = worlds_of(env, before), worlds_of(env, after)

    host.reset(seed=0)
    theirs = []
    for i, action in enumerate(actions.tolist()):
        load_world(host, World(*(part[i] for part in worlds_before)), int(times[i]))
        observation, reward, terminated, truncated, _ = host.step(action)
        theirs.append((observation, np.float32(reward), terminated, truncated, world_of(host)))
    observations, rewards, terminated, truncated, worlds = zip(*theirs, strict=True)
    np.testing.assert_array_equal(ours.observation, np.stack(observations))
    np.testing.assert_array_equal(ours.reward, rewards)
    np.testing.assert_array_equal(ours.terminated, terminated)
    np.testing.assert_array_equal(ours.truncated, truncated)
    for mine, other in zip(worlds_after, zip(*worlds, strict=True), strict=True):
        np.testing.assert_array_equal(mine, np.stack(other))
    return num_states


@pytest.mark.parametrize("env_id", [*FIVE, RANDOM])
def test_every_step_from_every_reachable_state(env_id: str) -> None:
    t = time.time()
    n = assert_steps_equal(env_id)
    print(env_id, n, time.time() - t)
