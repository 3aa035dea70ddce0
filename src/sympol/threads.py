"""The number of threads that JAX computes with on the CPU, which decides the last digits of sums."""

from __future__ import annotations

import os
import sys

_VARIABLES = ("PJRT_NPROC", "NPROC")
"""Environment variables that JAX reads at its first computation, before it counts the cores."""


def threads() -> int:
    """Return the number of threads of JAX in a process with this environment."""
    for name in _VARIABLES:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return cores()


def cores() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def use_one_thread() -> None:
    """Compute with one thread in this process and its children, unless the environment sets another number.

    For many trainings that is the fastest (docs/guides/cluster.md has numbers), and it makes results the same on
    machines with different numbers of cores. Call it before JAX computes anything; later it does nothing.
    """
    if any(name in os.environ for name in _VARIABLES):
        return
    if "jax" in sys.modules:
        from jax._src import xla_bridge  # nothing public tells

        if xla_bridge.backends_are_initialized():
            return
    os.environ[_VARIABLES[0]] = "1"
