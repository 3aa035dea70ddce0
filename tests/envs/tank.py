"""A tank whose level is to be held by a pump: the source of a file such as a user has, and how it is put on disk."""

from __future__ import annotations

from pathlib import Path

TANK = '''
import gymnasium
import numpy as np
from gymnasium import spaces


class Tank(gymnasium.Env):
    """A tank that fills; a pump empties it."""

    observation_space = spaces.Dict({"level": spaces.Box(0, 10, (), np.float32), "pump": spaces.Discrete(2)})
    action_space = spaces.Discrete(2)
    action_names = ("off", "on")

    def __init__(self, inflow=0.3):
        self.inflow = inflow

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.level, self.pump, self.time = self.np_random.uniform(2, 8), 0, 0
        return self._seen(), {}

    def step(self, action):
        self.pump, self.time = int(action), self.time + 1
        self.level = float(np.clip(self.level + self.inflow - 0.6 * self.pump, 0, 10))
        return self._seen(), -abs(self.level - 5), False, self.time >= 20, {}

    def _seen(self):
        return {"level": np.float32(self.level), "pump": self.pump}


class Sized(Tank):
    def __init__(self, size, inflow=0.3):
        super().__init__(inflow * size)


def make_tank(inflow=0.3):
    return Tank(inflow)


def make_nothing():
    Tank()


def make_trouble():
    return Tank().pipes


capacity = 3
works = Tank()
gymnasium.register("Tank-v0", Tank)
'''

JAX_WALK = """
from typing import NamedTuple

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np

from sympol.types import Step


class State(NamedTuple):
    position: jax.Array
    time: jax.Array


class Walk:
    feature_names = ("position",)
    observation_space = gymnasium.spaces.Box(0, 1, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, stride=0.1):
        self.stride, self.max_episode_steps = stride, 20

    def reset(self, key):
        state = State(jax.random.uniform(key, maxval=0.5), jnp.int32(0))
        return state, state.position[None]

    def step(self, key, state, action):
        position = jnp.clip(state.position + jnp.where(action == 1, self.stride, -self.stride), 0, 1)
        state = State(position, state.time + 1)
        ended = position >= 1
        return state, Step(position[None], jnp.where(ended, 1.0, 0.0), ended, state.time >= self.max_episode_steps)
"""


def write_tank(folder: Path, name: str = "tank.py") -> Path:
    """Write the file into a folder; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(TANK)
    return folder / name
