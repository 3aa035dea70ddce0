from __future__ import annotations

from fractions import Fraction
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete
from gymnasium.wrappers import TimeLimit

from sympol.envs.classic.cartpole import CartPole, CartPoleState
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.host_envs import HostEnvs
from sympol.envs.registry import resolve
from sympol.envs.spaces import Features


class Diary(gymnasium.Env):
    """Shows which step of which episode it is, in one array that it writes over and over.

    Episodes of copy i last 3 + i steps; the odd ones terminate, the even ones are truncated.
    """

    copies = 0

    def __init__(self) -> None:
        self.observation_space = Box(0, np.inf, (2,))
        self.action_space = Discrete(3, start=1)
        self.length = 3 + Diary.copies
        Diary.copies += 1
        self.page = np.zeros(2, np.float32)
        self.seen: list[Any] = []
        self.seeds: list[int | None] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        self.seeds.append(seed)
        self.page += (1, 0)
        self.page[1] = 0
        return self.page, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.seen.append(action)
        self.page[1] += 1
        ended, odd = self.page[1] >= self.length, self.page[0] % 2 == 1
        return self.page, float(self.page[1]), bool(ended and odd), bool(ended and not odd), {}


@pytest.fixture
def diaries(monkeypatch: pytest.MonkeyPatch) -> HostEnvs:
    monkeypatch.setattr(Diary, "copies", 0)
    return HostEnvs(Diary, 3, Features.of(Box(0, np.inf, (2,))), Discrete(3, start=1))


def test_the_last_observation_is_the_true_one_and_no_reset_leaks(diaries: HostEnvs) -> None:
    observation = diaries.reset(seed=0)
    assert observation.tolist() == [[1, 0]] * 3
    for _ in range(20):
        before = observation.copy()
        step, observation = diaries.step(np.zeros(3, np.int32))
        for i in range(3):
            episode, time = before[i]
            ended = time + 1 == 3 + i
            assert step.observation[i].tolist() == [episode, time + 1]
            assert step.reward[i] == time + 1
            assert step.terminated[i] == (ended and episode % 2 == 1)
            assert step.truncated[i] == (ended and episode % 2 == 0)
            assert observation[i].tolist() == ([episode + 1, 0] if ended else [episode, time + 1])


def test_what_was_returned_stays_as_it_was(diaries: HostEnvs) -> None:
    first = diaries.reset(seed=0)
    step, second = diaries.step(np.zeros(3, np.int32))
    kept = [np.array(array) for array in (first, second, *step)]
    for _ in range(5):
        diaries.step(np.zeros(3, np.int32))
    for array, copy in zip((first, second, *step), kept, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_arrays_are_of_the_types_of_a_step(diaries: HostEnvs) -> None:
    observation = diaries.reset(seed=0)
    step, next_observation = diaries.step(np.zeros(3, np.int32))
    for array in (observation, next_observation, step.observation):
        assert (array.shape, array.dtype) == ((3, 2), np.float32)
    assert step.reward.dtype == np.float32
    assert step.terminated.dtype == step.truncated.dtype == np.bool_


def copies_of(envs: HostEnvs) -> list[Any]:
    return [env.unwrapped for env in envs._group.envs]


def test_actions_arrive_where_the_space_starts(diaries: HostEnvs) -> None:
    diaries.reset(seed=0)
    diaries.step(np.array([0, 1, 2], np.int32))
    assert [env.seen for env in copies_of(diaries)] == [[1], [2], [3]]
    assert all(Discrete(3, start=1).contains(env.seen[0]) for env in copies_of(diaries))


def test_every_copy_and_every_seed_has_its_own_seeds(diaries: HostEnvs) -> None:
    for seed in (0, 1, 0):
        diaries.reset(seed)
    seeds = np.array([env.seeds for env in copies_of(diaries)])
    assert len(set(seeds[:, :2].ravel())) == 6
    np.testing.assert_array_equal(seeds[:, 0], seeds[:, 2])


class Echo(gymnasium.Env):
    """Keeps the last action; observes and pays what it is told to."""

    def __init__(self, action_space: gymnasium.Space, observation: Any = 0.0, reward: Any = 0.0) -> None:
        self.observation_space = Dict({"a": Box(-1, 1, ()), "b": Discrete(2)})
        self.action_space = action_space
        self.observation, self.reward = observation, reward
        self.action: Any = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return {"a": np.float32(0), "b": 1}, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        if isinstance(self.reward, str):
            raise ZeroDivisionError("by the environment")
        self.action = action
        return {"a": self.observation, "b": 1}, self.reward, False, False, {}


@pytest.mark.parametrize(
    ("space", "actions"),
    [
        (MultiDiscrete([2, 3], start=[1, 0]), np.array([[0, 0], [1, 2]], np.int32)),
        (Box(-0.1, 0.1, (2, 2), np.float64), np.full((2, 4), 0.1, np.float32)),
        (Box(-0.1, 0.1, (2, 2), np.float64), np.full((2, 2, 2), 0.1, np.float32)),
        (Box(-1, 1, (), np.float32), np.array([[0.5], [-0.5]], np.float32)),
    ],
    ids=str,
)
def test_every_action_is_one_of_the_spaces(space: Any, actions: Any) -> None:
    envs = resolve(lambda: Echo(space)).host_envs(2)
    envs.reset(seed=0)
    envs.step(actions)
    assert all(space.contains(np.asarray(env.action)) for env in copies_of(envs))


@pytest.mark.parametrize(
    ("observation", "reward", "says"),
    [
        (np.nan, 0.0, "environment 1 returned an observation that is not finite in float32: [nan  0.  1.]"),
        (1e39, 0.0, "environment 1 returned an observation that is not finite in float32: [inf  0.  1.]"),
        (0.0, np.nan, "environment 1 returned a reward that is not finite in float32: nan"),
        (0.0, -np.inf, "environment 1 returned a reward that is not finite in float32: -inf"),
        (
            0.0,
            None,
            "environment 1 failed in step(np.int64(0)): TypeError: reward must be a number, got NoneType None",
        ),
        (0.0, np.zeros(2), "TypeError: reward must be a number, got float64 array of shape (2,)"),
        (0.0, [[1.0], [2.0, 3.0]], "TypeError: reward must be a number, got list"),
        (0.0, 1j, "TypeError: reward must be a number, got complex 1j"),
        (0.0, "raise", "environment 1 failed in step(np.int64(0)): ZeroDivisionError: by the environment"),
        ("?", 0.0, "environment 1 failed in step(np.int64(0)): ValueError: observation['a'] must be"),
        (np.zeros(2), 0.0, "environment 1 failed in step(np.int64(0)): ValueError: all parts"),
    ],
)
def test_failures_name_the_environment_and_what_was_seen(observation: Any, reward: Any, says: str) -> None:
    sick = iter([False, True, False])
    envs = HostEnvs(
        lambda: Echo(Discrete(2), observation, reward) if next(sick) else Echo(Discrete(2)),
        3,
        Features.of(Dict({"a": Box(-1, 1, ()), "b": Discrete(2)})),
        Discrete(2),
    )
    envs.reset(seed=0)
    with pytest.raises(EnvironmentFailure) as error:
        envs.step(np.zeros(3, np.int32))
    assert says in str(error.value)


class Slip(gymnasium.Env):
    """Observes the step it is at; every third one ends the episode. What it answers besides, it is told."""

    observation_space = Box(0, 3, (1,))
    action_space = Discrete(2)

    def __init__(self, index: int = 0, **answers: Any) -> None:
        self.index, self.answers, self.time = index, answers, 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        self.time = 0
        answer = np.zeros(1, np.float32), self.info()
        return self.answers["begins"](*answer) if "begins" in self.answers else answer

    def step(self, action: Any) -> Any:
        self.time += 1
        flags = self.answers.get("flag", bool)
        answer = (
            np.float32([self.time]),
            self.answers.get("reward", 1.0),
            flags(self.time == 3),
            flags(False),
            self.info(),
        )
        return self.answers["goes_on"](*answer) if "goes_on" in self.answers else answer

    def info(self) -> Any:
        return self.answers["info"](self) if "info" in self.answers else {}


INFOS: dict[str, Any] = {
    "None": lambda env: None,
    "no dict": lambda env: 3,
    "shapes": lambda env: {"moves": np.arange(1 + env.index + env.time)},
    "types": lambda env: {"winner": None if env.time % 2 else 1, "path": "a" if env.index else 0.5},
    "keys": lambda env: {f"k{env.index}": 1, 7: 2},
    "nested": lambda env: {"a": {"b": None} if env.index else 1},
    "its own final_obs": lambda env: {"final_obs": np.zeros(env.time), "_final_obs": "?", "final_info": None},
}


@pytest.mark.parametrize("info", INFOS.values(), ids=INFOS)
def test_nothing_in_an_info_matters(info: Any) -> None:
    copies = iter(range(3))
    envs = HostEnvs(
        lambda: Slip(next(copies), info=info), 3, Features.of(Slip.observation_space), Slip.action_space
    )
    envs.reset(seed=0)
    for time in (1, 2, 3, 1, 2, 3):
        step, observation = envs.step(np.zeros(3, np.int32))
        assert (step.observation == time).all()
        assert (observation == time % 3).all()
        assert (step.terminated == (time == 3)).all()


@pytest.mark.parametrize(
    "reward",
    [np.array([2.5]), np.array([[2.5]]), np.array(2.5), [2.5], np.float16(2.5), Fraction(5, 2)],
    ids=str,
)
@pytest.mark.parametrize("flag", [bool, int, np.bool_, lambda done: np.array([done])])
def test_one_number_is_a_reward_and_a_flag_whatever_holds_it(reward: Any, flag: Any) -> None:
    envs = HostEnvs(
        lambda: Slip(reward=reward, flag=flag), 2, Features.of(Slip.observation_space), Slip.action_space
    )
    envs.reset(seed=0)
    for time in (1, 2, 3):
        step, _ = envs.step(np.zeros(2, np.int32))
        assert (step.reward == np.float32(2.5)).all()
        assert (step.terminated == (time == 3)).all()
        assert not step.truncated.any()


OLD_GYM: dict[str, Any] = {
    "observation alone": (
        {"begins": lambda o, i: o},
        "reset() must return (observation, info), got float32 array",
    ),
    "a list": ({"begins": lambda o, i: [o, i]}, "reset() must return (observation, info), got list"),
    "four": (
        {"goes_on": lambda o, r, t, u, i: (o, r, t, i)},
        "got 4 values; the older Gym interface has one flag, done",
    ),
    "none": (
        {"goes_on": lambda *_: None},
        "(observation, reward, terminated, truncated, info), got NoneType None",
    ),
    "flag": ({"flag": lambda done: None}, "terminated must be true or false, got NoneType None"),
}


@pytest.mark.parametrize(("answers", "says"), OLD_GYM.values(), ids=OLD_GYM)
def test_the_older_interface_is_named(answers: Any, says: str) -> None:
    envs = HostEnvs(lambda: Slip(**answers), 2, Features.of(Slip.observation_space), Slip.action_space)

    def play() -> None:
        envs.reset(seed=0)
        envs.step(np.zeros(2, np.int32))

    with pytest.raises(EnvironmentFailure) as error:
        play()
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_the_older_interface_inside_a_wrapper_is_named() -> None:
    answers = {"goes_on": lambda o, r, t, u, i: (o, r, t, i)}
    envs = HostEnvs(
        lambda: TimeLimit(Slip(**answers), 5), 2, Features.of(Slip.observation_space), Slip.action_space
    )
    envs.reset(seed=0)
    with pytest.raises(EnvironmentFailure, match="older Gym interface"):
        envs.step(np.zeros(2, np.int32))


def test_a_missing_space_is_named() -> None:
    for missing in ("observation_space", "action_space"):
        spaces: dict[str, Any] = {"observation_space": Box(0, 1, (1,)), "action_space": Discrete(2)}
        for base in (gymnasium.Env, object):
            del_one = {name: space for name, space in spaces.items() if name != missing}
            env = type("Half", (base,), {**del_one, "reset": Slip.reset, "step": Slip.step})
            with pytest.raises(ValueError, match=f"Half has no {missing}: set it"):
                resolve(env)
            with pytest.raises(ValueError, match=f"the {missing} of Half must be a space"):
                resolve(type("Half", (env,), {missing: (3,)})())


def test_a_twin_through_the_host_steps_like_the_one_in_jax() -> None:
    envs = resolve("CartPole-v1", backend="host").host_envs(4)
    observation = envs.reset(seed=0)
    step = jax.jit(jax.vmap(CartPole().step, in_axes=(None, 0, 0)))
    time = np.zeros(4, np.int32)
    for _ in range(50):
        action = (observation[:, 2] > 0).astype(np.int32)
        _, expected = step(
            jax.random.key(0), CartPoleState(jnp.asarray(observation), jnp.asarray(time)), action
        )
        result, observation = envs.step(action)
        for ours, theirs in zip(expected, result, strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-5)
        time = np.where(result.terminated, 0, time + 1)
    envs.close()
