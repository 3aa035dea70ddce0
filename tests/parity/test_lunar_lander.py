"""Our lunar landers against Gymnasium's, number by number: given the same chance, every episode is the same to the bit.

Gymnasium draws from the generator of the environment; here it draws from ours, so that ground, first push and how far
engines stray are the same. What follows is Box2D's work there, and `sympol.envs.lunar_lander`'s here. Only the last
observation of an episode that ends in a crash differs: how the lander would bounce is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sympol.envs.lunar_lander.batch import Copies, engine_power
from sympol.envs.lunar_lander.shapes import HULL, LEG
from sympol.envs.registry import resolve
from sympol.trees.floats import flushed

DISCRETE, CONTINUOUS = "LunarLander-v3", "LunarLanderContinuous-v3"
WORD = (1 << 64) - 1
Policy = Callable[[np.ndarray, np.random.Generator], Any]


class Dice:
    """SplitMix64 (Steele, Lea and Flood 2014), written down a second time, in place of Gymnasium's generator."""

    def __init__(self, seed: int) -> None:
        self.state = seed

    def random(self) -> float:
        self.state = self.state + 0x9E3779B97F4A7C15 & WORD
        z = self.state
        z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & WORD
        z = (z ^ z >> 27) * 0x94D049BB133111EB & WORD
        return ((z ^ z >> 31) >> 11) * 2.0**-53

    def uniform(self, low: float, high: float, size: Any = None) -> Any:
        if size is None:
            return low + (high - low) * self.random()
        return np.array([self.uniform(low, high) for _ in range(*size)])


def thrust(x: np.ndarray, height: float = 0.0) -> tuple[float, float]:
    """How much to push upwards and to which side to land, or to stay in the air: as Gymnasium's heuristic does."""
    lean = min(max(0.5 * x[0] + x[2], -0.4), 0.4)
    turn = 0.5 * (lean - x[4]) - x[5]
    lift = 0.5 * (height + 0.55 * abs(x[0]) - x[1]) - 0.5 * x[3]
    return (-0.5 * x[3], 0.0) if x[6] or x[7] else (float(lift), float(turn))


def chosen(lift: float, turn: float) -> int:
    if lift > abs(turn) and lift > 0.05:
        return 2
    return 0 if abs(turn) <= 0.05 else 3 if turn < 0 else 1


def lands(x: np.ndarray, rng: np.random.Generator) -> int:
    return chosen(*thrust(x))


def at_random(x: np.ndarray, rng: np.random.Generator) -> int:
    return int(rng.integers(4))


def sloppy(x: np.ndarray, rng: np.random.Generator) -> int:
    """Lands hard, aslant, on one leg, slides, hops and topples."""
    return at_random(x, rng) if rng.random() < 0.3 else lands(x, rng)


def lands_with_two_numbers(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    lift, turn = thrust(x)
    return np.clip([lift * 20 - 1, -turn * 20], -1, 1).astype(np.float32)


def two_numbers_at_random(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, 2).astype(np.float32)


def hovers(x: np.ndarray, rng: np.random.Generator) -> int:
    return chosen(*thrust(x, 1.0))


def episode(name: str, policy: Policy, seed: int) -> dict[str, float]:
    """Play it in both, and compare all that is seen; what it was like."""
    env: Any = resolve(name).make_host()
    env.unwrapped.np_random = Dice(seed)
    theirs, rng = env.reset()[0], np.random.default_rng(seed)
    ours = Copies(np.array([seed], np.uint64))
    every = np.ones(1, bool)
    np.testing.assert_array_equal(ours.observation[0], flushed(theirs))
    total, stood = 0.0, 0
    while True:
        action = policy(theirs, rng)
        theirs, reward, terminated, truncated, _ = env.step(action)
        moved = ours.step(engine_power(np.array([action])), every, np.zeros(1, np.uint64))
        assert moved.reward[0] == reward
        assert (moved.terminated[0], moved.truncated[0]) == (terminated, truncated)
        total += float(reward)
        crashed = terminated and reward == -100 and abs(theirs[0]) < 1
        if not crashed:
            np.testing.assert_array_equal(moved.observation[0], flushed(theirs))
        stood += theirs[6:].any()
        if terminated or truncated:
            env.close()
            return {"return": total, "stood": stood, "crashed": crashed, "truncated": truncated}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "policy", "episodes"),
    [
        pytest.param(DISCRETE, at_random, 30, id="falls"),
        pytest.param(DISCRETE, lands, 12, id="lands"),
        pytest.param(DISCRETE, sloppy, 16, id="lands badly"),
        pytest.param(CONTINUOUS, lands_with_two_numbers, 12, id="lands with two numbers"),
        pytest.param(CONTINUOUS, two_numbers_at_random, 20, id="falls with two numbers"),
    ],
)
def test_every_episode_is_the_same_to_the_bit(name, policy, episodes):
    played = [episode(name, policy, seed) for seed in range(episodes)]
    if policy in (at_random, two_numbers_at_random):
        assert sum(one["crashed"] for one in played) > episodes / 2
    else:
        assert sum(one["stood"] for one in played) > 20 * episodes


def test_the_clock_stops_it_as_gymnasium_does():
    assert episode(DISCRETE, hovers, 7)["truncated"]


@pytest.mark.parametrize(("solid", "number"), [(HULL, 0), (LEG, 1), (LEG, 2)])
def test_bodies_weigh_what_box2d_says(solid, number):
    env: Any = resolve(DISCRETE).make_host()
    env.reset(seed=0)
    body = [env.unwrapped.lander, *env.unwrapped.legs][number]
    shape = body.fixtures[0].shape
    np.testing.assert_array_equal(solid.vertices, np.float32(shape.vertices))
    np.testing.assert_array_equal(solid.normals, np.float32(shape.normals))
    np.testing.assert_array_equal(solid.centroid, np.float32(tuple(shape.centroid)))
    np.testing.assert_array_equal(solid.center, np.float32(tuple(body.localCenter)))
    assert solid.inverse_mass == np.float32(1) / np.float32(body.mass)
    assert solid.friction == np.float32(body.fixtures[0].friction)
    about_origin = 1 / float(solid.inverse_inertia) + body.mass * math.hypot(*body.localCenter) ** 2
    assert about_origin == pytest.approx(body.inertia, rel=1e-6)
