"""How many threads JAX computes with on the processor: it decides the last digits of a sum, so all must agree."""

from __future__ import annotations

import os
import sys

_SAID = ("PJRT_NPROC", "NPROC")
"""Where JAX looks when its first computation begins, before it counts the cores."""


def threads() -> int:
    """What JAX computes with in a process started with this environment."""
    for name in _SAID:
        if os.environ.get(name, "").isdigit():
            return int(os.environ[name])
    return cores()


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def use_one_thread() -> None:
    """Compute with one thread here and in every process started from here, unless the user has said otherwise.

    For many trainings that is the fastest (docs/guides/cluster.md has numbers), and it makes results the same on
    machines with different numbers of cores. Call it before JAX computes anything; later it does nothing.
    """
    if any(name in os.environ for name in _SAID):
        return
    if "jax" in sys.modules:
        from jax._src import xla_bridge  # nothing public tells

        if xla_bridge.backends_are_initialized():
            return
    os.environ[_SAID[0]] = "1"
