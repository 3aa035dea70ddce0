"""What trains without an error and is not what its user thinks is warned of, once, when the environment is resolved."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Space
from gymnasium.wrappers import FlattenObservation, NormalizeObservation, NormalizeReward, TimeLimit

import sympol
from sympol.envs.diagnostics import ManyFeatures, OwnStatistics


class Blank(gymnasium.Env):
    """Observes anything."""

    action_space = Discrete(2)

    def __init__(self, space: Space[Any]):
        self.observation_space = space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.observation_space.sample(), {}

    def step(self, action):
        return self.observation_space.sample(), 0.0, True, False, {}


def wrapped(*wrappers: type[gymnasium.Wrapper]) -> gymnasium.Env:
    env = gymnasium.make("CartPole-v1")
    for wrapper in wrappers:
        env = wrapper(env)
    return TimeLimit(env, 100)


@pytest.mark.parametrize(
    ("wrappers", "said"),
    [
        (
            [NormalizeObservation],
            "contains NormalizeObservation: every copy of it gathers statistics of its own",
        ),
        ([NormalizeReward], "contains NormalizeReward: .* what is reported is no return of the environment"),
        ([NormalizeObservation, NormalizeReward], "contains NormalizeReward and NormalizeObservation"),
    ],
)
def test_wrappers_with_statistics_of_their_own(wrappers, said):
    for env in (wrapped(*wrappers), lambda: wrapped(*wrappers)):
        with pytest.warns(OwnStatistics, match=said) as warned:
            sympol.resolve(env)
        assert len(warned) == 1
    with pytest.warns(OwnStatistics):
        sympol.PPO("tree", lambda: wrapped(*wrappers), num_envs=2)


@pytest.mark.parametrize(
    ("space", "said"),
    [
        (Box(0, 255, (84, 84, 3), np.uint8), r"pictures, of shape \(84, 84, 3\); each of the 21,168 numbers"),
        (Box(0, 255, (3, 20, 16), np.uint8), "pictures"),
        (Box(0, 1, (4, 64, 64), np.float32), "pictures"),
        (Box(0, 1, (28, 28), np.float32), r"pictures, of shape \(28, 28\)"),
        (Dict({"see": Box(0, 255, (28, 28), np.uint8), "speed": Box(0, 1, (1,))}), "pictures"),
        (Box(0, 1, (2001,)), "more than 2,000 features; each of the 2,001 numbers"),
    ],
)
def test_pictures_and_very_many_features(space, said):
    with pytest.warns(ManyFeatures, match=f"Blank returns .*{said}") as warned:
        sympol.resolve(lambda: Blank(space))
    assert len(warned) == 1


def test_a_flattened_picture_has_many_features():
    with pytest.warns(ManyFeatures, match="more than 2,000 features"):
        sympol.resolve(lambda: FlattenObservation(Blank(Box(0, 255, (84, 84), np.uint8))))


@pytest.mark.parametrize(
    "space",
    [
        Box(0, 1, (2000,)),
        Box(0, 1, (5, 7), np.float32),  # five cars, seven numbers each
        Box(0, 1, (200, 4), np.float32),  # a short history
        Box(0, 255, (8, 8), np.uint8),  # a board
        Box(0, 255, (128,), np.uint8),  # the memory of a game
        Discrete(500),
    ],
)
def test_no_warning_of_anything_else(space):
    sympol.resolve(lambda: Blank(space))  # a warning would be an error
    sympol.resolve("CartPole-v1")
