"""The purpose of each range of seeds, so that nothing chosen on a seed is ever reported on it.

| purpose | seeds | kept apart by |
|---|---|---|
| trainings that are reported | `TRAINING` | the range |
| trainings of a search for hyperparameters | `SEARCH` | the range |
| episodes of a training, of its validations, of distillation | even | parity (`HostEnvs.reset`, `episode_seed`) |
| test episodes | odd | parity (`episode_seed`) |

A training and its validations draw from streams of their own (`purpose_key`, `host_seed`). Compiled environments have
no seeds in common with the host: they draw from JAX's keys, machine code from a generator of its own, and every
test is played on Gymnasium.
"""

from __future__ import annotations

TRAINING = range(0, 1000)
"""Seeds of trainings that are reported."""
SEARCH = range(1000, 2**32)
"""Seeds of trainings that choose hyperparameters, of presets written by hand, too."""


def require_training_seed(seed: int) -> int:
    """Return ``seed`` if a training with it may be reported; otherwise raise ValueError."""
    return _require(seed, TRAINING, "of a training that is reported", "those above are for searches")


def require_search_seed(seed: int) -> int:
    """Return ``seed`` if a search may train with it; otherwise raise ValueError."""
    return _require(seed, SEARCH, "of a search", f"add {SEARCH.start}: those below are reported")


def _require(seed: int, seeds: range, what: str, remedy: str) -> int:
    if isinstance(seed, bool) or seed not in seeds:
        raise ValueError(
            f"a seed {what} must be a whole number from {seeds[0]} to {seeds[-1]}, got {seed!r}; {remedy}"
        )
    return int(seed)
