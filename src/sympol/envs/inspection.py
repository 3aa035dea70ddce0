"""The behaviour of an environment under random play, before a training: speed, lengths, rewards and features.

`sympol.envs.problems` judges what is measured here.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray

from .errors import EnvironmentFailure
from .host import advance, begin, too_large
from .spaces import LARGEST
from .spec import EnvSpec

LONGEST = 10_000
"""The number of steps after which an episode that does not end is left."""
MOST_STEPS = 50_000
"""Steps of random play, at most."""


@dataclass
class Episodes:
    """The finished episodes of random play.

    Attributes:
        returns: The sum of the rewards of each.
        lengths: The number of steps of each.
        terminated: The number of those that ended by themselves.
    """

    returns: list[float] = field(default_factory=list)
    lengths: list[int] = field(default_factory=list)
    terminated: int = 0


@dataclass
class Inspection:
    """The measurements of random play.

    Attributes:
        spec: The environment.
        steps: The number of steps.
        step_seconds: The mean time of a step.
        reset_seconds: The mean time of a reset.
        longest_step_seconds: The time of the slowest step after the first.
        low: The lowest value of each feature.
        high: The highest value of each feature.
        reward_low: The lowest reward of a step.
        reward_high: The highest reward of a step.
        episodes: The finished episodes.
        first_observations: The first observation of each episode ``[episodes, features]``.
        is_reused: Whether the environment returns the same array again, with other numbers in it.
        difference: What differed first between two episodes of the same seed and actions; empty if nothing did.
    """

    spec: EnvSpec
    steps: int
    step_seconds: float
    reset_seconds: float
    longest_step_seconds: float
    low: Float32[ndarray, " features"]
    high: Float32[ndarray, " features"]
    reward_low: float
    reward_high: float
    episodes: Episodes
    first_observations: Float32[ndarray, "episodes features"]
    is_reused: bool
    difference: str = ""

    @property
    def steps_per_second(self) -> float:
        """Steps a second of one copy, its resets included."""
        resets = len(self.episodes.lengths) / max(1, self.steps)
        return 1 / max(1e-9, self.step_seconds + resets * self.reset_seconds)

    @property
    def outside(self) -> Bool[ndarray, " features"]:
        """The features that left their declared bounds."""
        return (self.low < self.spec.features.low) | (self.high > self.spec.features.high)

    @property
    def sizes(self) -> Float64[ndarray, " features"]:
        """The largest magnitude of each feature."""
        return np.maximum(np.abs(self.low), np.abs(self.high)).astype(np.float64)


def inspect_env(spec: EnvSpec, *, seconds: float = 3.0, seed: int = 0) -> Inspection:
    """Play an environment at random and measure.

    Args:
        spec: The environment.
        seconds: How long to play, about; at least one episode or `LONGEST` steps are played, whatever they take.
        seed: The seed of the actions and of the first episode; those after it have the seeds that follow.

    Returns:
        What was measured.

    Raises:
        EnvironmentFailure: The environment raised an error, or returned what is no observation or no reward.
    """
    env = spec.make_host()
    try:
        player = _Player(spec, env, seed)
        player.play(seconds)
        difference = _first_difference(spec, env, seed)
    finally:
        if not spec.has_one_copy:
            env.close()
    return Inspection(
        spec=spec,
        steps=player.steps,
        step_seconds=player.step_seconds / max(1, player.steps),
        reset_seconds=player.reset_seconds / max(1, player.resets),
        longest_step_seconds=player.longest,
        low=player.low,
        high=player.high,
        reward_low=player.reward_low,
        reward_high=player.reward_high,
        episodes=player.episodes,
        first_observations=np.array(player.firsts),
        is_reused=player.is_reused,
        difference=difference,
    )


class _Player:
    """Random play, and what is seen of it."""

    def __init__(self, spec: EnvSpec, env: gymnasium.Env, seed: int) -> None:
        self.spec, self.env, self.seed = spec, env, seed
        self.steps, self.resets, self.longest = 0, 0, 0.0
        self.step_seconds = self.reset_seconds = 0.0
        count = len(spec.features.names)
        self.low, self.high = np.full(count, np.inf, np.float32), np.full(count, -np.inf, np.float32)
        self.reward_low, self.reward_high = np.inf, -np.inf
        self.episodes, self.is_reused = Episodes(), False
        self.firsts: list[Float32[ndarray, " features"]] = []

    def play(self, seconds: float) -> None:
        """Play episodes until the time is up."""
        self.env.action_space.seed(self.seed)
        if self.spec.env is not None:  # in JAX, whose first calls compile
            begin(self.env, seed=self.seed)
            advance(self.env, self.env.action_space.sample())
        until = time.perf_counter() + seconds
        while True:
            length = self._episode(until)
            if time.perf_counter() >= until or self.steps >= MOST_STEPS or length >= LONGEST:
                return

    def _episode(self, until: float) -> int:
        started = time.perf_counter()
        raw = begin(self.env, seed=self.seed + self.resets)
        self.reset_seconds += time.perf_counter() - started
        self.resets += 1
        self.firsts.append(self._seen(raw, "reset()"))
        earned, length = 0.0, 0
        while length < LONGEST:
            action = self.env.action_space.sample()
            before = raw.copy() if isinstance(raw, np.ndarray) else None
            started = time.perf_counter()
            step = advance(self.env, action)
            took = time.perf_counter() - started
            if before is not None and not np.array_equal(raw, before, equal_nan=raw.dtype.kind == "f"):
                self.is_reused = True
            self.longest = max(self.longest, took if self.steps else 0.0)
            self.step_seconds += took
            self.steps, length, raw = self.steps + 1, length + 1, step.observation
            self._seen(raw, f"step({action!r})")
            if not np.isfinite(np.float32(step.reward)):
                raise EnvironmentFailure(
                    f"step({action!r}) returned the reward {step.reward}, which is not finite"
                )
            self.reward_low = min(self.reward_low, step.reward)
            self.reward_high = max(self.reward_high, step.reward)
            earned += step.reward
            if step.terminated or step.truncated:
                self.episodes.returns.append(earned)
                self.episodes.lengths.append(length)
                self.episodes.terminated += step.terminated
                break
            if time.perf_counter() > until and self.episodes.lengths:
                break
        return length

    def _seen(self, raw: Any, where: str) -> Float32[ndarray, " features"]:
        try:
            row = self.spec.features.flatten(raw)
            if row.ndim != 1:
                raise ValueError(f"it must be a single observation, got a batch of shape {row.shape[:-1]}")
        except ValueError as error:
            raise EnvironmentFailure(
                f"{where} returned what is no observation of its space: {error}"
            ) from error
        names = self.spec.features.names
        for i in np.flatnonzero(~np.isfinite(row))[:1]:
            raise EnvironmentFailure(
                f"{where} returned {names[i]} = {row[i]}, which is not finite in float32"
            )
        for i in np.flatnonzero(np.abs(row) > LARGEST)[:1]:
            raise EnvironmentFailure(f"{where} returned {names[i]} = {row[i]:g}; {too_large([names[i]])}")
        np.minimum(self.low, row, out=self.low)
        np.maximum(self.high, row, out=self.high)
        return row


def _first_difference(spec: EnvSpec, env: gymnasium.Env, seed: int, steps: int = 100) -> str:
    """Play the same actions twice with the same seed; return in words what differs first, or nothing."""
    seen: list[list[tuple[Any, float, bool, bool]]] = []
    for _ in range(2):
        env.action_space.seed(seed)
        rows = [(spec.features.flatten(begin(env, seed=seed)), 0.0, False, False)]
        while len(rows) <= steps and not (rows[-1][2] or rows[-1][3]):
            step = advance(env, env.action_space.sample())
            rows.append((spec.features.flatten(step.observation), *step[1:]))
        seen.append(rows)
    for step, (first, second) in enumerate(zip(*seen, strict=False)):
        where = f"after step {step}" if step else "after the reset"
        differ = np.flatnonzero(first[0] != second[0])
        if len(differ):
            i = int(differ[0])
            return f"{spec.features.names[i]} {where} was {first[0][i]:.6g}, then {second[0][i]:.6g}"
        if first[1] != second[1]:
            return f"the reward {where} was {first[1]:.6g}, then {second[1]:.6g}"
        if first[2:] != second[2:]:
            return f"the episode ended {where} once, and not the other time"
    return ""
