"""Searches so small that they are over in seconds: tiny trainings on CartPole whose trials share one program."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import pytest
import tomli_w

from sympol.threads import threads
from sympol.tune.search_spaces import Range, Space
from sympol.tune.study import Search

from ..tiny import TINY

SPACE: Space = {
    "learning_rate_leaf_values": Range(1e-3, 0.1, log=True),
    "gamma": (0.9, 0.99),
}
"""Traced fields only."""
STEPS = TINY["total_timesteps"]
EVALS = TINY["num_evals"]


@pytest.fixture(autouse=True)
def as_others_compute(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers find the programs compiled here, and as many threads; import it where it is wanted."""
    for name, value in {
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir),  # pyright: ignore
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
        "SYMPOL_CACHE_DIR": "",
        "PJRT_NPROC": str(threads()),
        "PYTHONWARNINGS": "",
    }.items():
        monkeypatch.setenv(name, os.environ.get(name, value))


def tiny_preset(folder: Path) -> str:
    """A preset's file with everything small."""
    path = folder / "tiny.toml"
    fields = {key: value for key, value in TINY.items() if key != "total_timesteps"}
    path.write_text(tomli_w.dumps({"ppo": {"tree": {"default": fields}}}))
    return str(path)


def search(folder: Path, **options: Any) -> Search:
    defaults = {"total_timesteps": STEPS, "preset_name": tiny_preset(folder), "space": SPACE}
    return Search.of("CartPole-v1", **{**defaults, **options})


class Scripted:
    """In place of `agent_of`: no training, but validation returns as told by the number of the training."""

    def __init__(self, *curves: Sequence[float] | Exception) -> None:
        self.curves, self.seeds, self.configs = curves, [], []

    def __call__(self, spec: Any, config: Any, seed: int) -> Any:
        curve = self.curves[min(len(self.seeds), len(self.curves) - 1)]
        self.seeds.append(seed)
        self.configs.append(config)

        def learn(callback: Callable[[Any], None], progress_bar: bool) -> None:
            assert not progress_bar
            if isinstance(curve, Exception):
                raise curve
            for value in curve:
                callback(SimpleNamespace(metrics={"eval/mean_reward": value}))

        best = 0.0 if isinstance(curve, Exception) else max(curve)
        state = SimpleNamespace(validation=SimpleNamespace(best_return=best, last_return=0.0))
        return SimpleNamespace(config=config, state=state, learn=learn)
