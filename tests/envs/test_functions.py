"""Simulators that are two plain functions."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import sympol
from sympol.envs.errors import EnvironmentFailure

LEVEL = {"level": (0, 10), "pump": ["off", "on"]}


def start(rng: np.random.Generator) -> dict[str, Any]:
    return {"level": rng.uniform(2, 8), "pump": "off", "hours": 0}


def flow(state: dict[str, Any], action: str, rng: np.random.Generator) -> tuple[dict[str, Any], float, bool]:
    level = state["level"] + rng.uniform(0, 0.4) - (0.5 if action == "on" else 0.0)
    level = min(max(level, 0.0), 10.0)
    return {"level": level, "pump": action, "hours": state["hours"] + 1}, -abs(level - 5), level in (0, 10)


def tank(**options: Any) -> Any:
    return sympol.from_functions(
        start, flow, **{"observations": LEVEL, "actions": ["off", "on"], "max_steps": 30, **options}
    )


def test_names_bounds_and_limit_are_those_that_were_given():
    spec = sympol.resolve(tank(name="Tank"))
    assert spec.name == "Tank"
    assert spec.features.names == ("level", "pump is off", "pump is on")
    assert spec.features.low.tolist() == [0, 0, 0]
    assert spec.features.high.tolist() == [10, 1, 1]
    assert [group.name for group in spec.features.groups] == ["pump"]
    assert spec.actions.names == ("off", "on")
    assert spec.max_episode_steps == 30
    assert not spec.has_one_copy


def test_gymnasium_s_own_check_finds_nothing():
    check_env(tank()(), skip_render_check=True)


def test_an_episode_is_that_of_the_functions():
    env, rng = tank()(), np.random.default_rng(0)
    env.reset(seed=3)
    _, same = gymnasium.utils.seeding.np_random(3)[0], gymnasium.utils.seeding.np_random(3)[0]
    state = start(same)
    for step in range(1, 31):
        action = int(rng.integers(2))
        state, reward, done = flow(state, ["off", "on"][action], same)
        observation, earned, terminated, truncated, _ = env.step(action)
        np.testing.assert_array_equal(observation, np.float32([state["level"], action == 0, action == 1]))
        assert (earned, terminated) == (reward, done)
        assert truncated == (step == 30)
        if terminated:
            break


def test_a_tree_is_trained_and_reads_in_the_words_of_the_plant():
    agent = sympol.PPO(
        "tree",
        tank(),
        seed=0,
        depth=2,
        total_timesteps=512,
        num_envs=4,
        num_steps=32,
        num_evals=1,
        num_eval_episodes=2,
    )
    tree = agent.learn(progress_bar=False).tree(prune=False)
    assert tree.feature_names == ("level", "pump is off", "pump is on")
    assert {*tree.actions.names} == {"off", "on"}
    mean, _ = sympol.evaluate_policy(tree, tank(), 3)
    assert np.isfinite(mean)


class Boiler:
    """A simulator that changes itself."""

    def __init__(self, start: float) -> None:
        self.celsius, self.valve, self.alarm, self.minutes = start, 0.0, False, 0

    def run(self, valve: float, fan: float) -> None:
        self.celsius += 10 * valve - 5 * fan - 0.1 * (self.celsius - 20)
        self.valve, self.alarm, self.minutes = valve, self.celsius > 90, self.minutes + 1


def heat(boiler: Boiler, action: dict[str, float]) -> tuple[Boiler, float]:
    boiler.run(**action)
    return boiler, -abs(boiler.celsius - 60)


def test_a_simulator_with_a_state_of_its_own():
    make = sympol.from_functions(
        lambda rng: Boiler(rng.uniform(20, 40)),
        heat,
        observations={"celsius": (None, None), "alarm": bool, "minutes": range(101)},
        actions={"valve": (0, 1), "fan": (0, 0.5)},
        max_steps=100,
    )
    spec = sympol.resolve(make)
    assert spec.features.names == ("celsius", "alarm", "minutes")
    assert spec.features.integers == (1, 2)
    assert spec.features.high.tolist() == [np.inf, 1, 100]
    assert spec.actions.names == ("valve", "fan")
    env = make()
    before = env.reset(seed=0)[0][0]
    after = env.step(np.float32([1.0, 0.5]))[0]
    assert after[0] == pytest.approx(before + 7.5 - 0.1 * (before - 20), rel=1e-5)
    assert after[2] == 1


def test_several_choices_keep_their_options():
    got = []

    def step(state: dict[str, int], action: Any) -> tuple[dict[str, int], float]:
        got.append(action)
        return state, 0.0

    make = sympol.from_functions(
        lambda: {"x": 1},
        step,
        observations={"x": (0, 2)},
        actions={"pump": ["off", "on"], "speed": [10, 20, 30]},
    )
    spec = sympol.resolve(make)
    assert spec.actions.names == ("pump", "speed")
    assert spec.actions.words([1, 2]) == ("pump: on", "speed: 30")
    env = make()
    env.reset()
    env.step(np.array([1, 2]))
    assert got == [{"pump": "on", "speed": 30}]


def test_one_number_is_a_number():
    got = []

    def step(state: float, action: Any) -> tuple[float, float]:
        got.append(action)
        return state + action, 0.0

    make = sympol.from_functions(
        lambda: 1.0, step, observations={"x": (0, 9)}, actions=(-1, 1), observe=lambda state: {"x": state}
    )
    env = make()
    env.reset()
    assert env.step(np.float32([0.5]))[0].tolist() == [1.5]
    assert got == [0.5]


def test_it_can_be_sent_to_another_process():
    make = pickle.loads(pickle.dumps(tank()))
    first, second = (env.reset(seed=1)[0] for env in (make(), tank()()))
    np.testing.assert_array_equal(first, second)


def test_episodes_that_would_share_their_state_are_refused():
    shared = {"level": 5.0, "pump": "off"}
    make = sympol.from_functions(lambda: shared, flow, observations=LEVEL, actions=["off", "on"])
    first, second = make(), make()
    first.reset()
    first.reset()
    with pytest.raises(TypeError, match="reset must return a state of its own for each episode"):
        second.reset()
    first.close()
    second.reset()

    @dataclass(frozen=True)
    class Start:
        level: float = 5.0
        pump: str = "off"

    begun = Start()
    frozen = sympol.from_functions(lambda: begun, flow, observations=LEVEL, actions=["off", "on"])
    envs = [frozen(), frozen()]
    for env in envs:
        env.reset()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"observations": {}}, "observations must be a dictionary of names and values"),
        ({"observations": {"level": 3}}, "level must have its values: a range .*, got int 3"),
        ({"observations": {"level": (5, 5)}}, r"level must be a range \(low, high\) with low < high"),
        ({"observations": {"pump": ["on", "on"]}}, "pump must have options that differ"),
        ({"observations": {3: (0, 1)}}, "observations must have names that are text, got 3"),
        (
            {"actions": {"valve": (0, 1), "pump": ["off", "on"]}},
            "ranges for valve and options for pump: write a list",
        ),
        ({"actions": {"valve": (0, None)}}, "actions: valve must have two finite bounds"),
        ({"actions": 2}, "actions: actions must have its values"),
        ({"max_steps": 0}, "max_steps must be a whole number of at least 1"),
        ({"name": "my plant"}, "name must be a word"),
    ],
)
def test_descriptions_that_cannot_be_understood(options: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=message):
        tank(**options)


def test_functions_of_another_form_are_refused_at_once():
    with pytest.raises(
        TypeError, match=r"step must be a function that is called as step\(state, action, rng\)"
    ):
        sympol.from_functions(start, lambda state: state, observations=LEVEL, actions=["off", "on"])
    with pytest.raises(TypeError, match=r"reset must be a function, reset\(rng\), got dict"):
        sympol.from_functions({}, flow, observations=LEVEL, actions=["off", "on"])  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            {"level": 1.0, "pump": "on"},
            r"step must return \(state, reward\) or \(state, reward, done\), got dict",
        ),
        (({"level": 1.0, "pump": "on"}, 0.0, False, False, {}), "got 5 values"),
        ((None, 0.0), "step must return the next state first, got None"),
        (({"level": 1.0, "pump": "on"}, "much"), "a reward that is a number, got str 'much'"),
        (({"level": 1.0, "pump": "on"}, 0.0, "no"), "a done that is True or False, got str 'no'"),
        (({"level": 1.0}, 0.0), "the state that step returned must have 'pump', which is observed"),
        (({"level": 1.0, "pump": "On"}, 0.0), "pump must be one of 'off', 'on', got str 'On'"),
        (({"level": "high", "pump": "on"}, 0.0), "level must be a number, got str 'high'"),
    ],
)
def test_what_step_returned_is_named(answer: Any, message: str):
    make = sympol.from_functions(
        start, lambda state, action: answer, observations=LEVEL, actions=["off", "on"]
    )
    spec = sympol.resolve(make)
    envs = spec.host_envs(1)
    envs.reset(seed=0)
    with pytest.raises(EnvironmentFailure, match=message):
        envs.step(np.zeros(1, np.int32))
