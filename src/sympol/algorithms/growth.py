"""Schedules of the sizes of rollouts and batches. Nothing here imports JAX.

A rollout is a whole number of *chunks* of one fixed shape, so that one compiled program serves every stage: growing
changes how many chunks a loop visits, never a shape.
"""

from __future__ import annotations

from typing import Any

import numpy as np

NUM_STAGES = 8
"""The equal parts of a training, in each of which a dynamic rollout may double."""


def stage(timestep: Any, total_timesteps: int, max_stage: int) -> Any:
    """Compute the exponent k of the rollout size ``n_k = n_init · 2^k``: k = ⌈8(t + 1) / (T + 1)⌉ − 1, at most a limit.

    Args:
        timestep: The environment steps so far, t: an int, or an int32 scalar of JAX inside a program.
        total_timesteps: The environment steps of the whole training, T, at most 2^29.
        max_stage: The stage at which the rollout stops growing.

    Returns:
        The stage, of the type of ``timestep``.
    """
    if isinstance(timestep, int):
        return min((NUM_STAGES * timestep + NUM_STAGES - 1) // (total_timesteps + 1), max_stage)
    # the same in unsigned integers, so that T may go up to 2^29
    eighths = np.uint32(NUM_STAGES) * timestep.astype(np.uint32) + np.uint32(NUM_STAGES - 1)
    return (eighths // np.uint32(total_timesteps + 1)).clip(max=np.uint32(max_stage)).astype(np.int32)


def num_minibatches(chunk_size: int, minibatch_size: int) -> int:
    """Return the largest number of equal minibatches of a chunk that have at least ``minibatch_size`` samples each.

    Every sample is used exactly once in an epoch, so the number divides ``chunk_size``; a chunk that is too small is
    one batch.
    """
    most = max(1, chunk_size // minibatch_size)
    return next(n for n in range(most, 0, -1) if chunk_size % n == 0)
