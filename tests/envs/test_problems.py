"""What `sympol check` finds: environments with one fault each."""

from __future__ import annotations

import re
import time
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.algorithms.config import Config
from sympol.algorithms.work import work_of
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.inspection import Inspection, inspect_env
from sympol.envs.problems import problems


class Sound(gymnasium.Env[Any, Any]):
    """A walk on a line, with nothing wrong; subclasses break one thing each."""

    observation_space: gymnasium.Space[Any] = Box(-10, 10, (2,), np.float32)
    action_space: gymnasium.Space[Any] = Discrete(2)
    feature_names: tuple[str, ...] | None = ("place", "noise")
    action_names: tuple[str, ...] | None = ("left", "right")
    limit = 10

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.time, self.place = 0, float(self.np_random.uniform(-1, 1))
        return self.seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.time += 1
        self.place = float(np.clip(self.place + self.move(action), -10, 10))
        return self.seen(), self.reward(), False, self.time >= self.limit, {}

    def move(self, action: Any) -> float:
        return 0.5 if action else -0.5

    def reward(self) -> float:
        return -abs(self.place)

    def seen(self) -> Any:
        return np.array([self.place, self.np_random.uniform(-1, 1)], np.float32)


class Unnamed(Sound):
    feature_names = action_names = None


class Unbounded(Sound):
    action_space = Box(-np.inf, np.inf, (1,), np.float32)
    action_names = ("stride",)

    def move(self, action: Any) -> float:
        return float(action[0])


class Outside(Sound):
    observation_space = Box(-0.1, 0.1, (2,), np.float32)


class NoReward(Sound):
    def reward(self) -> float:
        return 0.0


class Endless(Sound):
    limit = 10**9


class FarApart(Sound):
    observation_space = Box(-np.inf, np.inf, (2,), np.float32)

    def seen(self) -> Any:
        return np.array([self.place * 1e5, self.np_random.uniform(-1, 1) * 1e-4], np.float32)


class Unseeded(Sound):
    def seen(self) -> Any:
        return np.array([self.place, np.random.uniform(-1, 1)], np.float32)  # noqa: NPY002, as users write it


class Reused(Sound):
    kept = np.zeros(2, np.float32)

    def seen(self) -> Any:
        self.kept[:] = super().seen()
        return self.kept


class SameStart(Sound):
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.place = 0.0
        return np.zeros(2, np.float32), {}


class Constant(Sound):
    def seen(self) -> Any:
        return np.array([self.place, 3], np.float32)


class NoSeed(Sound):
    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        gymnasium.Env.reset(self)
        self.time, self.place = 0, float(self.np_random.uniform(-1, 1))
        return self.seen(), {}


class SlowReset(Sound):
    limit = 2

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        time.sleep(0.01)
        return super().reset(**options)


class FlagOfZero(Sound):
    def step(self, action: Any) -> Any:
        observation, reward, _, truncated, info = super().step(action)
        return observation, reward, 0, truncated, info


def seen(env: Any, seconds: float = 0.05) -> Inspection:
    return inspect_env(sympol.resolve(env), seconds=seconds)


def test_nothing_is_found_in_a_sound_environment():
    inspection = seen(Sound)
    assert problems(inspection) == []
    assert inspection.episodes.lengths[:2] == [10, 10]
    assert inspection.episodes.terminated == 0
    assert inspection.reward_high <= 0
    assert inspection.steps == pytest.approx(10 * len(inspection.episodes.lengths), abs=10)


@pytest.mark.parametrize(
    ("env", "kind", "text"),
    [
        (Unbounded, "wrong", "actions have no bounds: stride"),
        (
            Unnamed,
            "note",
            r"a tree will speak of x\[0\] and action 0: give the environment feature_names and action_names",
        ),
        (
            Outside,
            "wrong",
            r"observations leave their space: place was -.* to .*, declared -0\.1 to 0\.1; noise was",
        ),
        (NoReward, "note", "the reward was 0 in all of"),
        (Endless, "wrong", "no episode ended within [0-9,]+ steps and there is no time limit"),
        (FarApart, "note", "features differ in size by a factor of .*: noise is at most .*, place up to"),
        (
            Unseeded,
            "wrong",
            "the same seed and the same actions gave two episodes: noise after the reset was",
        ),
        (NoSeed, "wrong", "the same seed and the same actions gave two episodes: place after the reset was"),
        (NoSeed, "note", "reset must take a seed and options"),
        (Reused, "note", "step returns the array that it returned before"),
        (SameStart, "note", "episodes begin with the same observation, whatever their seed"),
        (Constant, "note", "never changed in random play: noise = 3"),
        (SlowReset, "note", "a reset takes .* ms, as long as"),
        (SlowReset, "note", "steps a second is slow: a training of a million steps spends"),
        (FlagOfZero, "note", "step returns a terminated that is neither True nor False"),
    ],
)
def test_each_fault_is_said(env: type[Sound], kind: str, text: str):
    found = [problem.text for problem in problems(seen(env)) if problem.kind == kind]
    assert any(re.search(text, one) for one in found), found
    assert all("\n" not in one and "\x1b" not in one for one in found)


class NotFinite(Sound):
    def seen(self) -> Any:
        return np.array([np.nan if self.time else 0.0, 0.0], np.float32)


class OtherShape(Sound):
    def seen(self) -> Any:
        return np.zeros(3, np.float32)


class NanReward(Sound):
    def reward(self) -> float:
        return float("nan")


class OldGym(Sound):
    def step(self, action: Any) -> Any:
        observation, reward, _, truncated, info = super().step(action)
        return observation, reward, truncated, info


@pytest.mark.parametrize(
    ("env", "text"),
    [
        (NotFinite, r"step\(.*\) returned place = nan, which is not finite"),
        (OtherShape, r"reset\(\) returned what is no observation of its space: observation must be an array"),
        (NanReward, r"returned the reward nan, which is not finite"),
        (OldGym, r"step\(\) must return \(observation, reward, terminated, truncated, info\), got 4 values"),
    ],
)
def test_what_cannot_be_trained_on_is_refused(env: type[Sound], text: str):
    with pytest.raises(EnvironmentFailure, match=text):
        seen(env)


def test_the_work_of_a_training_is_counted():
    plain = Config(
        total_timesteps=4096, num_envs=4, num_steps=64, dynamic_rollout=False, minibatch_size=64, num_epochs=3
    )
    assert work_of(plain) == (16, 16 * 3 * 4, plain.num_evals, plain.num_evals * plain.num_eval_episodes)
    fixed = Config(num_envs=8, num_steps=128, total_timesteps=2**17, growth=4, dynamic_batch=False)
    grown = Config(num_envs=8, num_steps=128, total_timesteps=2**17, growth=4, dynamic_batch=True)
    assert work_of(fixed).rollouts == work_of(grown).rollouts
    assert work_of(fixed).optimizer_steps > work_of(grown).optimizer_steps
