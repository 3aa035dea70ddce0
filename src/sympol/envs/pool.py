"""Gymnasium environments rewritten in C++ by envpool, behind the interface of `HostEnvs`.

envpool's threads step all copies at once: on two cores some five times as fast as Gymnasium does. Where an
episode ends, the copy is reset in the same step, as everywhere else: left to itself, envpool would reset it in the
next one, and that row would be no experience. Its bounds are not to be trusted, so the spaces stay Gymnasium's.

Stepping happens on the host, not through envpool's XLA interface: that binds a compiled program to one pool,
and a pool cannot be seeded anew, so each new start would compile again.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Shaped
from numpy import ndarray

from ..trees.floats import flushed
from ..types import Step
from .host import MissingExtra, require_finite

TASKS = {"LunarLander-v3": "LunarLander-v3", "LunarLanderContinuous-v3": "LunarLanderContinuous-v3"}
"""Gymnasium's id → envpool's, for those whose twins have been compared (tests/parity/test_lunar_lander.py)."""


def is_installed() -> bool:
    """Whether envpool can be imported; it is not imported for that."""
    return importlib.util.find_spec("envpool") is not None


def find_task(name: str, as_it_is: bool, *, insist: bool) -> str | None:
    """What envpool calls the environment with Gymnasium's id ``name``, or None where it cannot be trained on there.

    ``as_it_is`` says that it is made without arguments, and is not another environment of that name.

    Raises:
        ValueError: ``insist``, and envpool does not have it.
        MissingExtra: ``insist``, and envpool is not installed.
    """
    task = TASKS.get(name) if as_it_is else None
    if insist:
        if task is None:
            raise ValueError(
                f"{name} cannot be trained on through envpool, which has {' and '.join(TASKS)}, by id and without "
                "env_kwargs; use backend='host' or 'auto'"
            )
        require_installed()
    return task if is_installed() else None


def require_installed() -> None:
    """Raise MissingExtra where envpool is not installed."""
    if not is_installed():
        raise MissingExtra(
            "backend 'envpool' needs a package that is not installed; install it: pip install 'sympol[envpool]', "
            "or use backend='host'"
        )


class PoolEnvs:
    """``num_envs`` copies of an environment, reset by themselves when an episode ends.

    Observations are a flat Box, actions a Box or a Discrete that starts at zero. Nothing is imported or made
    before the first reset.
    """

    def __init__(self, task: str, num_envs: int):
        """Name one of envpool's tasks."""
        self._task, self._num_envs, self._pool = task, num_envs, None

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return self._num_envs

    def reset(self, seed: int) -> Float32[ndarray, "envs features"]:
        """Start an episode in every copy, each with a seed of its own out of this one.

        A pool is seeded when it is made, so this makes a new one, which takes two milliseconds. What follows
        depends on the seed and the actions alone, not on the number of threads.

        Raises MissingExtra where envpool is not installed.
        """
        words = np.random.SeedSequence(seed).generate_state(self.num_envs)
        seeds = (words >> 2 << 1).tolist()  # even, as everywhere but in tests, and within int32
        self._pool = make_pool(self._task, seeds)
        observation = flushed(self._pool.reset()[0])
        require_finite("an observation", observation)
        return observation

    def step(
        self, actions: Shaped[ndarray, "envs ..."], wanted: Bool[ndarray, " envs"] | None = None
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, or in those ``wanted``; otherwise as `HostEnvs.step`.

        Raises EnvironmentFailure if a copy returns NaN or infinity.
        """
        assert self._pool is not None, "reset() comes first"
        if wanted is None or wanted.all():
            observation, reward, terminated, truncated, _ = self._pool.step(actions)
        else:
            results = self._pool.step(actions[wanted], np.flatnonzero(wanted))[:4]
            observation, reward, terminated, truncated = (_spread(result, wanted) for result in results)
        last_observation = flushed(observation)
        done = terminated | truncated
        next_observation = last_observation
        if done.any():
            next_observation = last_observation.copy()
            next_observation[done] = flushed(self._pool.reset(options={"reset_mask": done})[0])
            require_finite("a first observation of an episode", next_observation)
        require_finite("an observation", last_observation)
        require_finite("a reward", reward)
        step: Any = last_observation, reward, terminated, truncated  # NumPy's arrays, not JAX's
        return Step(*step), next_observation

    def close(self) -> None:
        """Let go of the copies; their threads end."""
        self._pool = None


def _spread(rows: ndarray, wanted: Bool[ndarray, " envs"]) -> ndarray:
    """The rows of those wanted, and zeros for the others."""
    full = np.zeros((len(wanted), *rows.shape[1:]), rows.dtype)
    full[wanted] = rows
    return full


def make_pool(task: str, seeds: Sequence[int]) -> Any:
    """envpool's own object, one copy for each of the seeds, which are int32.

    Raises MissingExtra where envpool is not installed.
    """
    require_installed()
    import envpool

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return envpool.make(
        task, env_type="gymnasium", num_envs=len(seeds), num_threads=min(len(seeds), cores), seed=list(seeds)
    )
