"""MiniGrid in JAX against Farama's package: no mismatch, in any state that can be reached."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest
from numpy.typing import NDArray

from sympol.envs.minigrid import TASKS, MiniGrid, make, make_host, random_layouts
from sympol.envs.minigrid.core import visible
from sympol.envs.minigrid.task import GridState
from tests.envs.minigrid_worlds import (
    World,
    all_starts,
    load_world,
    reachable,
    states_of,
    step_all,
    world_of,
    worlds_of,
)

RANDOM = "sympol/DistShift-Random-v0"
TABLED = (
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
    RANDOM,
)


def assert_steps_equal(
    env: MiniGrid, host: gymnasium.Env, states: GridState, actions: NDArray, times: NDArray
) -> None:
    """One step from each state: the same observation, reward, ends and next state on both sides."""
    before = states._replace(time=times.astype(np.int32))
    after, ours = step_all(env, before, actions)
    worlds_before, worlds_after = worlds_of(env, before), worlds_of(env, after)
    host.reset(seed=0)
    theirs = []
    for i, action in enumerate(actions.tolist()):
        load_world(host, World(*(part[i] for part in worlds_before)), int(times[i]))
        observation, reward, terminated, truncated, _ = host.step(action)
        theirs.append((observation, np.float32(reward), terminated, truncated, *world_of(host)))
    mine = (ours.observation, ours.reward, ours.terminated, ours.truncated, *worlds_after)
    for one, other in zip(mine, zip(*theirs, strict=True), strict=True):
        np.testing.assert_array_equal(one, np.stack(other))


def assert_reachable_steps_equal(env_id: str, num_states: int | None = None, **options: Any) -> None:
    """From every reachable state (or this many), by every action, at a first, a random and a last step in turn."""
    env, host = make(env_id, **options), make_host(env_id, **options)
    graph = reachable(env)
    rng = np.random.default_rng(0)
    rows = np.arange(len(graph.successor))
    if num_states is not None:
        rows = rng.choice(rows, num_states, replace=False)
    num_actions = len(env.view.actions)
    actions, rows = np.tile(np.arange(num_actions), len(rows)), np.repeat(rows, num_actions)
    limit = env.max_episode_steps
    times = rng.integers(limit, size=len(rows))
    turn = rng.permutation(len(rows)) % 3
    times[turn == 0], times[turn == 1] = 0, limit - 1
    assert_steps_equal(env, host, jax.tree.map(lambda x: x[rows], graph.states), actions, times)


@pytest.mark.parametrize("env_id", [*TABLED, "MiniGrid-DoorKey-5x5-v0"])
def test_every_step_from_every_reachable_state(env_id: str) -> None:
    assert_reachable_steps_equal(env_id)


def test_all_actions_in_all_planes() -> None:
    """With a key that may be dropped, in the doorway too, and a door that may be closed again."""
    assert_reachable_steps_equal("MiniGrid-DoorKey-5x5-v0", planes=range(20), actions=range(7))


@pytest.mark.parametrize("view_size", [5, 7, 9])
@pytest.mark.parametrize("env_id", ["MiniGrid-DoorKey-6x6-v0", "MiniGrid-LavaGapS7-v0"])
def test_larger_views(env_id: str, view_size: int) -> None:
    assert_reachable_steps_equal(env_id, 300, view_size=view_size)


@pytest.mark.parametrize("view_size", [3, 7])
@pytest.mark.parametrize(
    "env_id", ["MiniGrid-SimpleCrossingS9N1-v0", "MiniGrid-LavaCrossingS9N1-v0", "MiniGrid-FourRooms-v0"]
)
def test_steps_of_random_episodes(env_id: str, view_size: int) -> None:
    env, host = make(env_id, view_size=view_size), make_host(env_id, view_size=view_size)
    rng = np.random.default_rng(0)
    actions = rng.choice(3, 1000, p=[0.2, 0.2, 0.6])
    worlds, times, is_over = [], [], True
    for step, action in enumerate(actions.tolist()):
        if is_over or step % 30 == 0:
            host.reset(seed=step)
        worlds.append(world_of(host))
        times.append(host.unwrapped.step_count)  # type: ignore[attr-defined]
        _, _, terminated, truncated, _ = host.step(action)
        is_over = terminated or truncated
    assert_steps_equal(env, host, states_of(env, worlds), actions, np.array(times))


@pytest.mark.parametrize("env_id", TASKS)
def test_first_observations_rewards_and_time_limit(env_id: str) -> None:
    env, host = make(env_id), make_host(env_id)
    farama: Any = host.unwrapped
    assert env.max_episode_steps == farama.max_steps
    observations, worlds = [], []
    for seed in range(5):
        observations.append(host.reset(seed=seed)[0])
        worlds.append(world_of(host))
    np.testing.assert_array_equal(jax.vmap(env.observe)(states_of(env, worlds)), np.stack(observations))
    for time in range(farama.max_steps + 1):
        farama.step_count = time
        assert env.rewards[time] == np.float32(farama._reward())


def test_the_observation_is_farama_s_one_hot_image() -> None:
    from minigrid.wrappers import OneHotPartialObsWrapper

    planes = (17, 2, 5, 18, 4)
    host = make_host("MiniGrid-DoorKey-6x6-v0", planes=planes, view_size=5)
    flat = host.get_wrapper_attr("view")
    theirs = OneHotPartialObsWrapper(gymnasium.make("MiniGrid-DoorKey-6x6-v0", agent_view_size=5))
    for seed in range(20):
        image = theirs.reset(seed=seed)[0]["image"]
        np.testing.assert_array_equal(host.reset(seed=seed)[0], image[:, :, list(planes)].ravel())
    assert flat.num_features == 5 * 5 * len(planes)


def fingerprint(world: World) -> bytes:
    return b"".join(part.tobytes() for part in world)


def assert_drawn_with(counts: Iterable[int], expected: Sequence[float] | NDArray) -> None:
    """χ², which exceeds this bound less than once in 10,000 draws (the seeds are fixed)."""
    expected = np.asarray(expected)
    statistic = float(((np.array(list(counts)) - expected) ** 2 / expected).sum())
    freedom = len(expected) - 1
    assert statistic < freedom + 4 * np.sqrt(2 * freedom) + 8


@pytest.mark.parametrize(
    ("env_id", "num_resets"),
    [
        ("MiniGrid-Empty-8x8-v0", 5),
        ("MiniGrid-DistShift2-v0", 5),
        ("MiniGrid-Empty-Random-6x6-v0", 1000),
        ("MiniGrid-LavaGapS5-v0", 100),
        ("MiniGrid-LavaGapS7-v0", 300),
        ("MiniGrid-DoorKey-5x5-v0", 1000),
        ("MiniGrid-DoorKey-6x6-v0", 3000),
        ("MiniGrid-SimpleCrossingS9N1-v0", 500),
        (RANDOM, 1000),
    ],
)
def test_episodes_start_as_farama_s_do(env_id: str, num_resets: int) -> None:
    env, host = make(env_id), make_host(env_id)
    states, probability = all_starts(env)
    assert probability.sum() == pytest.approx(1)
    ours = Counter()
    for i, p in enumerate(probability.tolist()):
        ours[fingerprint(World(*(part[i] for part in worlds_of(env, states))))] += p  # type: ignore[assignment]
    host.reset(seed=0)
    theirs = Counter()
    for _ in range(num_resets):
        host.unwrapped.reset()
        theirs[fingerprint(world_of(host))] += 1
    assert theirs.keys() <= ours.keys()
    if num_resets * probability.min() > 15:  # else a start may well not have come up
        assert theirs.keys() == ours.keys()
    assert_drawn_with([theirs[world] for world in ours], [num_resets * p for p in ours.values()])


def test_resets_draw_every_start_alike() -> None:
    env = make("MiniGrid-DoorKey-6x6-v0")
    states, _ = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 20_000))
    listed, probability = all_starts(env)
    index = {row.tobytes(): i for i, row in enumerate(start_rows(listed))}
    counts = np.bincount([index[row.tobytes()] for row in start_rows(states)], minlength=len(index))
    assert_drawn_with(counts, probability * 20_000)


def start_rows(states: GridState) -> NDArray:
    return np.concatenate([np.asarray(part).reshape(len(states.time), -1) for part in states], axis=1)


def test_four_rooms_start_as_farama_s_do() -> None:
    """Gaps, agent and goal are drawn one after the other: each is compared by itself, and agent with goal."""
    env, host = make("MiniGrid-FourRooms-v0"), make_host("MiniGrid-FourRooms-v0")
    states, _ = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 3000))
    rows = [World(*parts) for parts in zip(*worlds_of(env, states), strict=True)]
    theirs = []
    host.reset(seed=0)
    for _ in range(1000):
        host.unwrapped.reset()
        theirs.append(world_of(host))
    for worlds in (rows, theirs):
        num = len(worlds)
        described = [describe(world) for world in worlds]
        for gap in range(4):
            assert_drawn_with(Counter(d[gap] for d in described).values(), [num / 8] * 8)
        assert_drawn_with(Counter(int(w.direction) for w in worlds).values(), [num / 4] * 4)
        for who in (4, 5):  # in which of the four rooms, or in a gap
            where = Counter(d[who] for d in described)
            assert_drawn_with([where[r] for r in range(5)], np.array([64, 64, 64, 64, 4]) * num / 260)
        assert not any(tuple(w.position) == goal_of(w) for w in worlds)


def describe(world: World) -> tuple[int, ...]:
    """Where the four gaps are, and the rooms of agent and goal, 4 for a gap."""
    from sympol.envs.minigrid.cells import WALL

    is_open = world.cells != WALL
    lines = is_open[1:9, 9], is_open[10:18, 9], is_open[9, 1:9], is_open[9, 10:18]
    assert all(line.sum() == 1 for line in lines)
    rooms = (4 if 9 in (x, y) else 2 * (y > 9) + (x > 9) for x, y in (world.position, goal_of(world)))
    return *(int(line.argmax()) for line in lines), *(int(room) for room in rooms)


def goal_of(world: World) -> tuple[int, int]:
    from sympol.envs.minigrid.cells import GOAL

    ((y, x),) = np.argwhere(world.cells == GOAL)
    return int(x), int(y)


def test_layouts_can_be_pinned() -> None:
    env, host = make(RANDOM), make_host(RANDOM)
    worlds = worlds_of(env, all_starts(env)[0])
    for i, (row, goal) in enumerate(random_layouts()):
        host.reset(seed=i, options={"strip2_row": row, "goal": goal})
        assert fingerprint(world_of(host)) == fingerprint(World(*(part[i] for part in worlds)))
    assert len(random_layouts()) == 56
    for seed in range(20):
        host.reset(seed=seed, options={"goal": (4, 2)})  # on the strip, if that were in row 2
        assert host.unwrapped.strip2_row == 5  # type: ignore[attr-defined]
        host.reset(seed=seed, options={"strip2_row": 2})
        assert host.unwrapped.strip2_row == 2  # type: ignore[attr-defined]
    assert len({goal_of_seed(host, seed) for seed in range(100)}) > 20
    for wrong in ({"strip2_row": 3}, {"goal": (1, 1)}, {"goal": (4, 2), "strip2_row": 2}, {"gaol": (2, 2)}):
        with pytest.raises(ValueError, match="options must be strip2_row"):
            host.reset(options=wrong)


def goal_of_seed(host: gymnasium.Env, seed: int) -> tuple[int, int]:
    host.reset(seed=seed)
    return goal_of(world_of(host))


@pytest.mark.parametrize("size", [3, 5, 7, 9, 31])
def test_sight(size: int) -> None:
    from minigrid.core.grid import Grid
    from minigrid.core.world_object import Wall

    rng = np.random.default_rng(0)
    opaque = rng.random((100, size, size)) < rng.choice([0.1, 0.3, 0.5], (100, 1, 1))
    ours = jax.jit(jax.vmap(visible))(opaque)
    for walls, seen in zip(opaque, np.asarray(ours), strict=True):
        grid = Grid(size, size)
        for i, j in np.argwhere(walls):
            grid.set(i, j, Wall())
        np.testing.assert_array_equal(seen, grid.process_vis((size // 2, size - 1)))
