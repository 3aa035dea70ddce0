"""An environment for tests of worker processes; as in most modules with environments, nothing here needs JAX."""

from __future__ import annotations

import os
import signal
import sys
import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete


class Chance(gymnasium.Env):
    """Draws everything at random; observes, too, whether JAX is imported where it runs."""

    observation_space = Dict({"a": Box(-1, 1, (2,)), "b": Discrete(3), "jax": Discrete(2)})
    action_space = Box(-1, 1, (2,))

    def __init__(self, on_step: str = "") -> None:
        self.on_step = on_step

    def _observe(self) -> dict[str, Any]:
        a = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        return {"a": a, "b": self.np_random.integers(3), "jax": int("jax" in sys.modules)}

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return self._observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        if self.on_step == "raise":
            raise ZeroDivisionError("by the environment")
        if self.on_step == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.on_step == "sleep":
            time.sleep(60)
        ended = self.np_random.uniform() < 0.1
        return (
            self._observe(),
            float(action.sum()),
            bool(ended),
            self.np_random.uniform() < 0.05,
            {"x": lambda: 0},
        )
