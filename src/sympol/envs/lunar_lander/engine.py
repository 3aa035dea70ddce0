"""The lunar landers as a `sympol.envs.capabilities.NativeEngine`.

Nothing is imported or compiled before the first episode: Numba takes seconds.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, Shaped, UInt64
from numpy import ndarray

from ...types import Step
from ..capabilities import TreeArrays
from ..errors import MissingExtra
from ..seeds import nth_episode_seed

IDS = ("LunarLander-v3", "LunarLanderContinuous-v3")
"""Environments that do the same as Gymnasium's to the bit (tests/parity/test_lunar_lander.py)."""


def is_installed() -> bool:
    """Return whether Numba can be imported, without importing it."""
    return importlib.util.find_spec("numba") is not None


class LunarLanderEngine:
    """Machine code for both lunar landers; the form of the actions tells them apart. See `NativeEngine`."""

    @property
    def install_hint(self) -> str:
        """See `NativeEngine.install_hint`."""
        return "with Numba it trains faster: pip install 'sympol[box2d]'"

    def is_installed(self) -> bool:
        """See `NativeEngine.is_installed`."""
        return is_installed()

    def require_installed(self) -> None:
        """See `NativeEngine.require_installed`."""
        if not is_installed():
            raise MissingExtra(
                "backend 'native' needs Numba, which is not installed; install it: pip install 'sympol[box2d]', or use "
                "backend='host'"
            )

    def make_envs(self, num_envs: int) -> NativeEnvs:
        """See `NativeEngine.make_envs`."""
        return NativeEnvs(num_envs)

    def play(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        tree_of: Int32[ndarray, " episodes"],
        seeds: UInt64[ndarray, " episodes"],
    ) -> tuple[Float64[ndarray, " episodes"], Int32[ndarray, " episodes"]]:
        """See `NativeEngine.play`."""
        from .batch import engine_power, rollout

        return rollout(trees, engine_power(actions), tree_of, seeds)

    def play_similar(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        seeds: UInt64[ndarray, " episodes"],
    ) -> tuple[Float64[ndarray, "trees episodes"], Int32[ndarray, "trees episodes"], int]:
        """See `NativeEngine.play_similar`."""
        from .batch import engine_power, rollout_similar

        return rollout_similar(trees, engine_power(actions), seeds)

    def observe(
        self,
        trees: TreeArrays,
        actions: Shaped[ndarray, "trees nodes ..."],
        seeds: UInt64[ndarray, " episodes"],
    ) -> Float32[ndarray, "steps features"]:
        """See `NativeEngine.observe`."""
        from .batch import engine_power, observe

        return observe(trees, engine_power(actions), seeds)


ENGINE = LunarLanderEngine()


class NativeEnvs:
    """``num_envs`` landers, each restarted when its episode ends; see `sympol.envs.capabilities.VectorEnvs`."""

    replays = True
    skipped = None

    def __init__(self, num_envs: int):
        self._num_envs, self._copies = num_envs, None
        self._seed, self._next_seeds = 0, np.zeros(num_envs, np.uint64)
        self._episode = np.arange(num_envs)

    @property
    def num_envs(self) -> int:
        """Number of copies, E."""
        return self._num_envs

    @property
    def was_cut(self) -> bool:
        """False: the landers have a time limit of their own."""
        return False

    @property
    def episode(self) -> Int64[ndarray, " envs"]:
        """The number of the episode that each copy plays."""
        return self._episode.copy()

    def reset(
        self, seed: int, num_episodes: int | None = None, episodes: Int64[ndarray, " envs"] | None = None
    ) -> Float32[ndarray, "envs features"]:
        """Begin an episode in every copy; ``num_episodes`` is ignored, as more cost next to nothing.

        See `VectorEnvs.reset`.

        Raises:
            MissingExtra: Numba is not installed.
        """
        ENGINE.require_installed()
        from .batch import Copies

        numbers = np.arange(self.num_envs) if episodes is None else np.asarray(episodes, np.int64)
        begins = numbers >= 0
        self._seed, self._episode = seed, np.where(begins, numbers, self._episode)
        seeds = self._seeds(self._episode)
        if self._copies is None or begins.all():
            self._copies = Copies(seeds)
        else:
            self._copies.restart(np.flatnonzero(begins), seeds)
        self._next_seeds = self._seeds(self._episode + self.num_envs)
        return self._copies.observation.copy()

    def _seeds(self, episodes: Int64[ndarray, " n"]) -> UInt64[ndarray, " n"]:
        return np.array([nth_episode_seed(self._seed, int(i), np.uint64) for i in episodes], np.uint64)

    def step(
        self,
        actions: Shaped[ndarray, "envs ..."],
        wanted: Bool[ndarray, " envs"] | None = None,
        max_steps: int | None = None,
    ) -> tuple[Step, Float32[ndarray, "envs features"]]:
        """Take one step in every copy, or in those ``wanted``; ``max_steps`` is ignored. See `VectorEnvs.step`."""
        assert self._copies is not None, "reset() comes first"
        from .batch import engine_power

        every = np.ones(self.num_envs, bool) if wanted is None else wanted
        result = self._copies.step(engine_power(np.asarray(actions)), every, self._next_seeds)
        ended = np.flatnonzero(result.terminated | result.truncated)
        self._episode[ended] += self.num_envs
        self._next_seeds[ended] = self._seeds(self._episode[ended] + self.num_envs)
        step: Any = (
            result.observation,
            result.reward.astype(np.float32),
            result.terminated,
            result.truncated,
        )  # NumPy's arrays, not JAX's
        return Step(*step), self._copies.observation.copy()

    def close(self) -> None:
        """Release the copies."""
        self._copies = None
