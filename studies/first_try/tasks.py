"""A task of the study: an environment, a budget, and the baselines that need no training."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import gymnasium
import numpy as np


@dataclass(frozen=True)
class Task:
    """An environment as a user brings it, and how many steps there are to learn it.

    Attributes:
        name: The name in tables and results.
        env: An id of Gymnasium, or a class or function that makes the environment.
        steps: Environment steps of a training.
        rule: A hand-written controller: a function from an observation, as the environment returns it, to an action.
        idle: The action that does nothing, where there is one.
        needs: A module that the environment needs; the task is left out where it is not installed.
    """

    name: str
    env: str | Callable[..., gymnasium.Env]
    steps: int
    rule: Callable[[Any], Any] | None = None
    idle: Any = None
    needs: str | None = None

    def digest(self) -> str:
        """Return a short hash of all that makes a result of this task comparable with another one."""
        parts = [str(self.steps), repr(self.idle)]
        parts += [x if isinstance(x, str) else inspect.getsource(x) for x in (self.env, self.rule) if x]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:12]


class Episodic(gymnasium.Env[Any, Any]):
    """An environment of episodes of a fixed length, which may end before.

    A subclass sets the spaces and ``length``, and defines `begin`, `observe` and `advance`.
    """

    length: ClassVar[int]
    t = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        super().reset(seed=seed)
        self.t = 0
        self.begin()
        return self.observe(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take an action."""
        reward, over = self.advance(action)
        self.t += 1
        return self.observe(), float(reward), over, not over and self.t >= self.length, {}

    def begin(self) -> None:
        """Draw the first state."""
        raise NotImplementedError

    def observe(self) -> Any:
        """Return the observation."""
        raise NotImplementedError

    def advance(self, action: Any) -> tuple[float, bool]:
        """Move to the next state; return the reward, and whether the task has ended."""
        raise NotImplementedError


def box(low: Any, high: Any, size: int | None = None) -> gymnasium.spaces.Box:
    """Return a box of float32 with these bounds, numbers or sequences, for ``size`` features."""
    shape = (len(low) if size is None else size,)
    low, high = (np.broadcast_to(np.asarray(bound, np.float32), shape) for bound in (low, high))
    return gymnasium.spaces.Box(low, high, dtype=np.float32)


def array(*values: float) -> np.ndarray:
    """Return the values as an observation."""
    return np.array(values, np.float32)


def number(action: Any, low: float, high: float) -> float:
    """Return the single number of a continuous action, within its bounds."""
    return min(max(float(np.asarray(action).ravel()[0]), low), high)


def one_hot(*choices: tuple[int, int]) -> np.ndarray:
    """Return the concatenated one-hot vectors of choices, each a pair of its index and the number of categories."""
    values = np.zeros(sum(count for _, count in choices), np.float32)
    start = 0
    for index, count in choices:
        values[start + index] = 1
        start += count
    return values
