"""The budget and the cost of a search: environment steps and seconds."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True)
class Budget:
    """A limit on a search, which ends as soon as either part is spent."""

    steps: float = math.inf
    """Environment steps."""
    seconds: float = math.inf
    """Seconds of wall-clock time."""

    def part(self, share: float) -> Budget:
        """Return a part of this budget.

        Args:
            share: The part, such as 0.5 for one half.

        Returns:
            So much of the steps and of the seconds.
        """
        return Budget(self.steps * share, self.seconds * share)


class CountsSteps(Protocol):
    """An object that counts its environment steps, such as an evaluator."""

    steps: int


class Meter:
    """The environment steps and seconds since it was made.

    Args:
        counter: The evaluator, or whatever else plays, whose steps are counted.
    """

    def __init__(self, counter: CountsSteps) -> None:
        self._counter, self._before, self._began = counter, counter.steps, time.perf_counter()

    @property
    def steps(self) -> int:
        """Environment steps so far."""
        return self._counter.steps - self._before

    @property
    def seconds(self) -> float:
        """Seconds so far."""
        return time.perf_counter() - self._began

    def has(self, budget: Budget) -> bool:
        """Return True while neither part of a budget is spent."""
        return self.steps < budget.steps and self.seconds < budget.seconds

    def left(self, budget: Budget) -> Budget:
        """Return what is left of a budget; below 0 where more was spent."""
        return Budget(budget.steps - self.steps, budget.seconds - self.seconds)

    def fraction(self, budget: Budget) -> float:
        """Return the part of a budget that is spent, of steps or of seconds, whichever is more; 1 is all of it."""
        return max(self.steps / budget.steps, self.seconds / budget.seconds)


@dataclass(frozen=True)
class Cost:
    """The cost of a tree or a search; costs can be added.

    Raises:
        ValueError: A number that is negative or not finite.
    """

    env_steps: int = 0
    """Environment steps of trainings, searches and selection, without those of teachers and tests."""
    teacher_steps: int = 0
    """Environment steps that teachers were trained with."""
    selection_episodes: int = 0
    """Validation episodes by which trees were chosen."""
    seconds: float = 0.0

    @classmethod
    def of(cls, meter: Meter) -> Cost:
        """Return the cost that a meter has counted so far."""
        return cls(env_steps=meter.steps, seconds=meter.seconds)

    def __post_init__(self) -> None:
        """Check."""
        for name in ("env_steps", "teacher_steps", "selection_episodes"):
            object.__setattr__(self, name, whole_number(name, getattr(self, name)))
        object.__setattr__(self, "seconds", finite_number("seconds", self.seconds))
        if self.seconds < 0:
            raise ValueError(f"seconds must not be negative, got {self.seconds}")

    @property
    def steps(self) -> int:
        """Environment steps, including those of teachers."""
        return self.env_steps + self.teacher_steps

    def __add__(self, other: Cost) -> Cost:
        """Return the sum of two costs."""
        return Cost(*(getattr(self, part.name) + getattr(other, part.name) for part in fields(self)))


def whole_number(name: str, value: Any, *, least: int = 0) -> int:
    """Return a value as an int.

    Args:
        name: What to call it in messages.
        value: The value.
        least: The smallest number that is allowed.

    Returns:
        The same number.

    Raises:
        ValueError: It is no whole number, or is below ``least``.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(value)


def finite_number(name: str, value: Any) -> float:
    """Return a value as a float.

    Args:
        name: What to call it in messages.
        value: The value.

    Returns:
        The same number.

    Raises:
        ValueError: It is no number, or is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise ValueError(f"{name} must be a finite number, got {value!r}")
    return float(value)


NO_COST = Cost()
"""The cost of nothing."""
