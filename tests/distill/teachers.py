"""Experts written by hand, and worlds small enough to know every step of."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete

from sympol.distill import Teacher
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec

from ..tiny import Chain

CARTPOLE = resolve("CartPole-v1", backend="host")
PENDULUM = resolve("Pendulum-v1", backend="host")
GAINS = np.array([0.3, 0.6, 4.0, 1.2])


def cartpole() -> Teacher:
    """A linear controller that never falls (500 on each of 50 episodes); its values are what it goes by."""
    return Teacher.from_callable(
        lambda x: (x @ GAINS > 0).astype(int),
        CARTPOLE,
        action_values=lambda x: np.stack([-x @ GAINS, x @ GAINS], axis=1),
        batched=True,
    )


def pendulum() -> Teacher:
    """Pump energy until it suffices to stand, then hold (−149 over 50 episodes)."""

    def torque(x: np.ndarray) -> np.ndarray:
        cos, sin, speed = x.T
        energy = speed**2 / 6 + 5 * (cos - 1)
        swing = -2 * np.sign(speed + 1e-6) * np.clip(energy, -1, 1)
        hold = -12 * np.arctan2(sin, cos) - 3 * speed
        return np.where((cos > 0.85) & (np.abs(speed) < 3), hold, swing)[:, None]

    return Teacher.from_callable(torque, PENDULUM, batched=True)


class Line(gymnasium.Env):
    """Start at 0 and step left (0) or right (1), rewarded for right; an episode is three steps."""

    observation_space = Box(-3, 3, (1,))
    action_space = Discrete(2)
    seeds: list[int]

    def __init__(self, seeds: list[int]) -> None:
        self.seeds = seeds

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict[str, Any]]:
        assert seed is not None
        self.seeds.append(seed)
        self.at = self.time = 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.at, self.time = self.at + (1 if action else -1), self.time + 1
        return np.array([self.at], np.float32), float(action), self.time == 3, False, {}


def line() -> tuple[EnvSpec, list[int]]:
    """The line, and the seeds that it has been reset with."""
    seeds: list[int] = []
    return resolve(lambda: Line(seeds)), seeds


def chain(observation_space: gymnasium.Space, action_space: gymnasium.Space) -> EnvSpec:
    """An environment of any two spaces."""
    return resolve(lambda: Chain(observation_space, action_space))
