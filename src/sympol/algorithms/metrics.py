"""Metrics that a training reports between two segments, and the check that its numbers are finite."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from ..envs.errors import EnvironmentFailure
from ..envs.host import too_large
from .state import TrainState


def require_finite(state: TrainState, before: int, names: Sequence[str]) -> None:
    """Check that a training holds finite numbers only.

    Args:
        state: The state after a segment.
        before: The timestep at the start of the segment, for the message.
        names: The names of the features.

    Raises:
        EnvironmentFailure: A parameter or the validation return is NaN or infinite, or a feature is too large to be
            scaled.
    """
    unscaled = np.flatnonzero(np.isnan(np.asarray(state.normalizer.shift)))
    if unscaled.size:
        raise EnvironmentFailure(
            f"in its first {int(state.timestep):,} steps the environment returned an observation that is not finite or "
            f"too large: {too_large([names[feature] for feature in unscaled.tolist()])}"
        )
    numbers = [*jax.tree.leaves(state.networks), state.validation.last_return]
    if not all(np.isfinite(np.asarray(leaf)).all() for leaf in numbers):
        raise EnvironmentFailure(
            f"between training steps {before:,} and {int(state.timestep):,} the training came to NaN or infinity: "
            "the environment returned an observation or a reward that is not finite, or the learning rates are "
            "too high"
        )


def metrics_of(state: TrainState, elapsed: float, fps: float) -> dict[str, float]:
    """Return the numbers of the last segment under stable-baselines3's names.

    Args:
        state: The state after the segment.
        elapsed: Seconds of training so far.
        fps: Environment steps per second.

    Returns:
        The metrics of the loop, then those of the algorithm's last update. Means over no episode are NaN.
    """
    episodes = max(1, int(state.episodes.num_ended))
    nothing = float("nan") if int(state.episodes.num_ended) == 0 else 0.0
    return {
        "time/total_timesteps": int(state.timestep),
        "time/time_elapsed": elapsed,
        "time/fps": fps,
        "rollout/ep_rew_mean": float(state.episodes.sum_return) / episodes + nothing,
        "rollout/ep_len_mean": float(state.episodes.sum_length) / episodes + nothing,
        "eval/mean_reward": float(state.validation.last_return),
        **{name: float(value) for name, value in state.metrics.items()},
    }
