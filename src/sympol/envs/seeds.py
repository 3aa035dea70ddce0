"""Seeds of the episodes that the host steps."""

from __future__ import annotations

from typing import Any

import numpy as np


def nth_episode_seed(seed: int, episode: int, dtype: Any = np.uint32) -> int:
    """Return the seed of one episode of those that `sympol.envs.capabilities.VectorEnvs.reset` begins.

    Args:
        seed: The seed of all these episodes.
        episode: The number of the episode, from 0.
        dtype: The type of the seed, `numpy.uint32` or `numpy.uint64`.

    Returns:
        The seed. It is even, as no test episode's is (`sympol.play.episode_seed`).
    """
    return int(np.random.SeedSequence([seed, episode]).generate_state(1, dtype)[0]) & ~1
