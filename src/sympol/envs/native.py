"""Gymnasium environments that are stepped by our own machine code, behind the interface of `HostEnvs`.

Where an episode ends, the copy is reset in the same step, as everywhere else. Nothing is imported or compiled before
the first reset.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Shaped
from numpy import ndarray

from ..types import Step
from .host import MissingExtra

TASKS = ("LunarLander-v3", "LunarLanderContinuous-v3")
"""Those that do the same as Gymnasium's to the bit (tests/parity/test_lunar_lander.py)."""


def is_installed() -> bool:
    """Whether Numba can be imported; it is not imported for that."""
    return importlib.util.find_spec("numba") is not None


def has_task(name: str, as_it_is: bool, *, insist: bool) -> bool:
    """Whether the environment with Gymnasium's id ``name`` can be trained on here.

    ``as_it_is`` says that it is made without arguments, and is not another environment of that name.

    Raises:
        ValueError: ``insist``, and it is not one of the `TASKS`.
        MissingExtra: ``insist``, and Numba is not installed.
    """
    known = name in TASKS and as_it_is
    if insist:
        if not known:
            raise ValueError(
                f"{name} cannot be stepped by our own machine code, which has {' and '.join(TASKS)}, by id and without "
                "env_kwargs; use backend='host' or 'auto'"
            )
        require_installed()
    return known and is_installed()


def require_installed() -> None:
    """Raise MissingExtra where Numba is not installed."""
    if not is_installed():
        raise MissingExtra(
            "backend 'native' needs Numba, which is not installed; install it: pip install 'sympol[box2d]', or use "
            "backend='host'"
        )


class NativeEnvs:
    """``num_envs`` copies of an environment, reset by themselves when an episode ends."""

    def __init__(self, num_envs: int):
        """Say how many."""
        self._num_envs, self._flights = num_envs, None

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return self._num_envs

    @property
    def was_cut(self) -> bool:
        """As in `HostEnvs`: never, since these environments have a time limit of their own."""
        return False

    def reset(self, seed: int) -> Float32[ndarray, "envs features"]:
        """Start an episode in every copy, each with a seed of its own out of this one.

        Raises MissingExtra where Numba is not installed.
        """
        require_installed()
        from .lunar_lander.flights import Flights

        self._flights = Flights(np.random.SeedSequence(seed).generate_state(self.num_envs, np.uint64))
        return self._flights.observation.copy()

    def step(
        self,
        actions: Shaped[ndarray, "envs ..."],
        wanted: Bool[ndarray, " envs"] | None = None,
        max_steps: int | None = None,
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, or in those ``wanted``; otherwise as `HostEnvs.step`.

        ``max_steps`` is not looked at: the landers have a time limit of their own.
        """
        assert self._flights is not None, "reset() comes first"
        from .lunar_lander.flights import engines

        every = np.ones(self.num_envs, bool) if wanted is None else wanted
        moved = self._flights.step(engines(np.asarray(actions)), every)
        step: Any = (
            moved.observation,
            moved.reward.astype(np.float32),
            moved.terminated,
            moved.truncated,
        )  # NumPy's arrays, not JAX's
        return Step(*step), self._flights.observation.copy()

    def close(self) -> None:
        """Let go of the copies."""
        self._flights = None
