"""Whole trainings, in this process and in others: the same trees."""

from __future__ import annotations

import jax
import pytest

from ..tiny import quick_compiles
from .tasks import task
from .test_workers import results

__all__ = ["quick_compiles"]


@pytest.mark.slow
def test_trainings_in_processes_give_the_same_trees(monkeypatch):
    monkeypatch.setenv(
        "JAX_DISABLE_MOST_OPTIMIZATIONS", "true"
    )  # workers have what `quick_compiles` sets here
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", jax.config.values["jax_compilation_cache_dir"])
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    tasks = [task(f"t{seed}", "train", seed=seed) for seed in range(2)]
    here = results(tasks)
    assert results(tasks, workers=2) == here
    assert here["t0"] != here["t1"]
