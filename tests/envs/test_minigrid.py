"""MiniGrid as a user meets it: names, groups, bounds, options, refusals. That it is Farama's: tests/parity."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.envs.capabilities import UNREACHABLE, steps_to_goal
from sympol.envs.env import Env
from sympol.envs.errors import MissingExtra, UnknownEnvironment
from sympol.envs.minigrid import TASKS, View, make, make_host, state_graph
from sympol.envs.minigrid.cells import EMPTY, LAVA, UNSEEN, WALL
from sympol.envs.minigrid.state_graph import observe_all
from sympol.envs.registry import resolve
from sympol.trees.groups import require_one_hot

from .minigrid_worlds import all_starts, optimal_returns, reachable, step_all

DOOR_KEY = "MiniGrid-DoorKey-5x5-v0"
SMALL = (
    "MiniGrid-Empty-Random-6x6-v0",
    DOOR_KEY,
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MiniGrid-DistShift1-v0",
    "sympol/DistShift-Random-v0",
)


@pytest.mark.parametrize("env_id", TASKS)
def test_every_task_keeps_the_protocol_and_has_a_twin(env_id: str) -> None:
    spec = resolve(env_id)
    env = spec.env
    assert isinstance(env, Env)
    assert {env: 1}[make(env_id)] == 1  # hashable, and equal to another of its kind
    assert spec.max_episode_steps == env.task.max_steps  # type: ignore[attr-defined]
    assert spec.make_host is not None
    host = spec.make_host()
    assert (host.observation_space, host.action_space) == (spec.observation_space, spec.action_space)
    assert host.get_wrapper_attr("feature_names") == spec.features.names
    assert host.get_wrapper_attr("action_names") == spec.actions.names
    assert host.get_wrapper_attr("groups") == spec.features.groups

    with jax.numpy_dtype_promotion("strict"), jax.numpy_rank_promotion("raise"):
        state, observation = env.reset(jax.random.key(0))
        new_state, step = env.step(jax.random.key(1), state, jnp.int32(2))
    assert spec.observation_space.contains(np.asarray(observation))
    assert spec.observation_space.contains(np.asarray(step.observation))
    assert [(part.shape, part.dtype) for part in step[1:]] == [((), jnp.float32), ((), bool), ((), bool)]
    assert jax.tree.map(jax.typeof, state) == jax.tree.map(jax.typeof, new_state)
    assert jax.typeof(observation) == jax.typeof(step.observation)
    assert spec.max_episode_steps is not None
    for time, truncated in ((spec.max_episode_steps - 2, False), (spec.max_episode_steps - 1, True)):
        late = state._replace(time=jnp.int32(time))
        assert bool(env.step(jax.random.key(1), late, jnp.int32(0))[1].truncated) is truncated


@pytest.mark.parametrize("env_id", SMALL)
def test_bounds_and_groups_hold_wherever_one_can_come(env_id: str) -> None:
    env = make(env_id)
    graph = reachable(env)
    num_states, num_actions = graph.successor.shape
    each = jax.tree.map(lambda x: np.repeat(x, num_actions, axis=0), graph.states)
    _, step = step_all(env, each, np.tile(np.arange(num_actions), num_states))
    seen = np.concatenate([observe_all(env, graph.states), np.asarray(step.observation)])
    assert (seen >= env.view.low).all()
    assert (seen <= env.view.high).all()
    require_one_hot(env.groups, seen)
    kinds = 2 if env_id == DOOR_KEY else 1
    assert len(env.groups) == kinds * 9
    assert sum(len(group.features) for group in env.groups) == env.view.num_features


def test_names_places_and_actions() -> None:
    spec = resolve(DOOR_KEY)
    names = [group.name for group in spec.features.groups if not group.name.endswith(" state")]
    assert names == [
        *("2 ahead, 1 left", "front-left", "left"),
        *("2 ahead", "front", "here"),
        *("2 ahead, 1 right", "front-right", "right"),
    ]
    front, state = (group for group in spec.features.groups if group.name in ("front", "front state"))
    assert (front.cell, state.cell) == ((1, 1), (1, 1))
    assert front.categories == ("unseen", "empty", "wall", "door", "key", "goal")
    assert state.categories == ("open", "closed", "locked")
    assert spec.features.names[front.features[3]] == front.words(front.features[3]) == "front is door"
    assert spec.features.names[state.features[2]] == state.words(state.features[2]) == "front state is locked"
    assert spec.actions.names == ("turn left", "turn right", "move forward", "pick up", "toggle")

    larger = make(DOOR_KEY, view_size=7, planes=[15, 1], actions=[6, 4])
    assert larger.feature_names[:2] == ("6 ahead, 3 left colour is yellow", "6 ahead, 3 left is empty")
    assert "1 ahead, 2 right is empty" in larger.feature_names
    assert "3 left is empty" in larger.feature_names
    assert larger.action_names == ("done", "drop")


def test_a_group_exists_only_where_nothing_is_left_out() -> None:
    lava_gap = make("MiniGrid-LavaGapS5-v0", planes=[0, 1, 2, 8, 17])
    # lava is left out everywhere but in the agent's own cell, which is always empty
    objects = [group for group in lava_gap.groups if not group.name.endswith(" state")]
    assert [group.name for group in objects] == ["here"]
    assert len(lava_gap.groups) == 1 + 9
    colours = make("MiniGrid-LavaGapS5-v0", planes=range(11, 17)).groups
    assert [group.name for group in colours][:2] == ["2 ahead, 1 left colour", "front-left colour"]


def test_bounds_say_what_never_changes() -> None:
    def fixed(env_id: str) -> dict[str, float]:
        view = make(env_id).view
        rows = zip(view.feature_names, view.low.tolist(), view.high.tolist(), strict=True)
        return {name: low for name, low, high in rows if low == high}

    here = dict.fromkeys(("here is unseen", "here is wall", "here is goal"), 0.0)
    assert fixed("MiniGrid-FourRooms-v0") == {**here, "here is empty": 1}
    door_key = {
        "here is door": 0,
        "here state is open": 1,
        "here state is closed": 0,
        "here state is locked": 0,
    }
    assert fixed(DOOR_KEY) == {**here, **door_key}
    through_walls = fixed("MiniGrid-DistShift1-v0")
    assert through_walls["front is unseen"] == 0
    assert "front is lava" not in through_walls


@pytest.mark.parametrize("backend", ["jax", "host"])
@pytest.mark.parametrize(
    ("env_kwargs", "message"),
    [
        ({"view_size": 4}, "view_size must be an odd number from 3 to 31, got 4; MiniGrid's own is 7"),
        ({"view_size": 1}, "view_size must be an odd number from 3 to 31, got 1"),
        ({"view_size": 3.0}, "view_size must be an odd number from 3 to 31, got 3.0"),
        ({"planes": [0, 20]}, r"planes must be .* from 0 to 19, got \[0, 20\]; they are 0 unseen, 1 empty"),
        ({"planes": [2, 2]}, "planes must be one or more different numbers"),
        ({"planes": ["wall"]}, "planes must be one or more different numbers"),
        ({"planes": 3}, "planes must be one or more different numbers"),
        ({"actions": []}, r"actions must be .* from 0 to 6, got \[\]; they are 0 turn left"),
        ({"actions": [7]}, "actions must be one or more different numbers"),
        ({"size": 5}, "env_kwargs {'size': 5} do not fit this environment"),
    ],
)
def test_options_that_are_refused(env_kwargs: dict[str, Any], message: str, backend: Any) -> None:
    with pytest.raises(ValueError, match=message):
        resolve(DOOR_KEY, env_kwargs=env_kwargs, backend=backend)


@pytest.mark.parametrize("backend", ["jax", "host"])
def test_options_reach_both_forms(backend: Any) -> None:
    options = {"view_size": 5, "planes": [1, 2], "actions": (2, 0)}
    spec = resolve(DOOR_KEY, env_kwargs=options, backend=backend)
    assert len(spec.features.names) == 5 * 5 * 2
    assert spec.actions.names == ("move forward", "turn left")
    assert spec.host_envs(2).reset(seed=0).shape == (2, 50)
    assert spec.make_host is not None
    assert spec.make_host().reset(seed=0)[0].shape == (50,)


def test_all_other_tasks_are_played_on_the_host() -> None:
    for env_id, num_actions in (
        ("MiniGrid-Fetch-5x5-N2-v0", 7),
        ("MiniGrid-KeyCorridorS3R1-v0", 7),
        ("MiniGrid-Dynamic-Obstacles-5x5-v0", 3),
        ("BabyAI-GoToLocal-v0", 7),
    ):
        spec = resolve(env_id)
        assert spec.env is None
        assert len(spec.features.names) == 9 * 19
        assert len(spec.features.groups) == 9 * 3
        assert len(spec.actions.names) == num_actions
        envs = spec.host_envs(2)
        observation = envs.reset(seed=0)
        rng = np.random.default_rng(0)
        for _ in range(100):
            require_one_hot(spec.features.groups, observation)
            assert (observation >= spec.features.low).all()
            assert (observation <= spec.features.high).all()
            _, observation = envs.step(rng.integers(num_actions, size=2))
    with pytest.raises(ValueError, match=r"actions must be from 0 to 2, .* got \(0, 5\)"):
        resolve("MiniGrid-Dynamic-Obstacles-5x5-v0", env_kwargs={"actions": [0, 5]})


@pytest.mark.parametrize(
    ("env_id", "near"),
    [
        ("MiniGrid-Emty-5x5-v0", "MiniGrid-Empty-5x5-v0"),
        ("minigrid-doorkey-5x5-v0", "MiniGrid-DoorKey-5x5-v0"),
        ("MiniGrid-LockedRooms-v0", "MiniGrid-LockedRoom-v0"),
        ("BabyAI-GoToObjj-v0", "BabyAI-GoToObj-v0"),
        ("DistShift-Random-v0", "sympol/DistShift-Random-v0"),
    ],
)
def test_unknown_ids_are_answered_with_minigrid_s(env_id: str, near: str) -> None:
    with pytest.raises(UnknownEnvironment) as error:
        resolve(env_id)
    assert repr(near) in str(error.value)


@pytest.mark.parametrize("env_id", [DOOR_KEY, "MiniGrid-Fetch-5x5-N2-v0", "MiniGrid-Nothing-v0"])
def test_without_the_package(env_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtra, match=r"install it: pip install 'sympol\[minigrid\]'"):
        resolve(env_id)


def test_the_package_is_imported_only_to_evaluate() -> None:
    program = (
        "import sys, sympol; from sympol.envs.registry import resolve; resolve('CartPole-v1');"
        "spec = resolve('MiniGrid-DoorKey-5x5-v0');"
        "print([m for m in ('minigrid', 'pygame') if m in sys.modules]); spec.make_host(); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    before, after = done.stdout.strip().splitlines()[-2:]
    assert before == "[]"
    assert "minigrid" in after.split()


def test_the_twin_refuses_other_actions_and_can_be_made_again() -> None:
    host = make_host(DOOR_KEY)
    host.reset(seed=0)
    for action in (5, -1):
        with pytest.raises(ValueError, match=r"action must be from 0 to 4 .turn left, .*toggle.*, got"):
            host.step(action)
    spec = resolve(host)
    assert (spec.name, spec.can_be_copied, spec.actions.names) == (
        DOOR_KEY,
        True,
        make(DOOR_KEY).action_names,
    )
    assert len(spec.features.groups) == 18
    assert spec.host_envs(2).reset(seed=0).shape == (2, 81)


def test_rendering_is_farama_s() -> None:
    host = make_host("MiniGrid-LavaGapS5-v0", render_mode="rgb_array")
    host.reset(seed=0)
    picture: Any = host.render()
    assert picture.shape == (5 * 32, 5 * 32, 3)


def test_a_view_of_ones_own() -> None:
    view = View(planes=(0, 1, 2, 9), elsewhere=(UNSEEN, EMPTY, WALL, LAVA), here=(EMPTY,))
    image = np.zeros((3, 3, 3), np.uint8)
    image[0, 2] = 9, 0, 0
    shown = view.encode(image)
    assert shown.dtype == np.float32
    assert [
        name for name, x in zip(view.feature_names, shown, strict=True) if x and "unseen" not in name
    ] == ["left is lava"]


def test_the_shortest_way() -> None:
    env = make("MiniGrid-Empty-5x5-v0")
    graph = reachable(env)
    assert steps_to_goal(graph.successor, graph.reaches_goal)[0] == 5  # two ahead, a turn, two ahead
    seeds = range(8)
    hosts = [make_host(DOOR_KEY) for _ in seeds]
    for seed, host in zip(seeds, hosts, strict=True):
        host.reset(seed=seed)
    best = optimal_returns(make(DOOR_KEY), hosts)
    graph = reachable(make(DOOR_KEY))
    steps = steps_to_goal(graph.successor, graph.reaches_goal)
    assert (steps < UNREACHABLE).all()
    assert set(best) <= {1 - 0.9 * (n / 250) for n in steps.tolist()}
    without_key = make(DOOR_KEY, actions=(0, 1, 2, 5))
    assert (optimal_returns(without_key, hosts) == 0).all()


@pytest.mark.parametrize("options", [{}, {"view_size": 5, "planes": (1, 2), "actions": (0, 2, 3, 5)}])
def test_all_observations_are_those_of_random_episodes_and_of_every_state(options: dict[str, Any]) -> None:
    env, spec = make(DOOR_KEY, **options), resolve(DOOR_KEY, env_kwargs=options, backend="host")
    listed = env.all_observations()
    assert listed is not None
    assert listed is make(DOOR_KEY, **options).all_observations()
    assert not listed.flags.writeable
    np.testing.assert_array_equal(listed, np.unique(observe_all(env, reachable(env).states), axis=0))
    np.testing.assert_array_equal(listed, spec.all_observations())  # of its twin, too
    envs, rng = spec.host_envs(8), np.random.default_rng(0)
    seen, known = [envs.reset(seed=0)], {row.tobytes() for row in listed}
    for _ in range(400):
        seen.append(envs.step(rng.integers(len(env.view.actions), size=8))[1])
    met = {row.tobytes() for row in np.concatenate(seen)}
    assert met <= known
    assert len(met) > len(known) / 2


@pytest.mark.parametrize("limit", ["MAX_STATES", "MAX_NUMBERS"])
def test_large_worlds_are_not_listed(limit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for env_id in ("MiniGrid-FourRooms-v0", "MiniGrid-DoorKey-16x16-v0"):
        assert make(env_id).all_observations() is None
    spec = resolve("MiniGrid-Fetch-5x5-N2-v0")
    assert spec.all_observations() is None
    for most in (1, 55, 100, 159):  # starts of DoorKey: 48; states: 160
        monkeypatch.setattr(state_graph, limit, most)
        assert state_graph.all_observations.__wrapped__(make(DOOR_KEY)) is None


def test_too_many_starts_to_list() -> None:
    with pytest.raises(ValueError, match="too many starts"):
        all_starts(make("MiniGrid-FourRooms-v0"))
    assert isinstance(gymnasium.make("sympol/DistShift-Random-v0").observation_space, gymnasium.spaces.Dict)
