"""What is said of a training between two segments, and that it still makes sense."""

from __future__ import annotations

from collections.abc import Sequence

import jax
import numpy as np

from ..envs.adapters.gymnasium import EnvironmentFailure, too_large
from .state import TrainState


def require_finite(state: TrainState, before: int, names: Sequence[str]) -> None:
    """Raise EnvironmentFailure where a training has come to NaN or infinity since timestep ``before``.

    ``names`` are those of the features, some of which the environment may have made too large to be scaled.
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
    """The last segment in numbers, under stable-baselines3's names."""
    episodes = max(1, int(state.episodes.num_ended))
    nothing = float("nan") if int(state.episodes.num_ended) == 0 else 0.0
    return {
        "time/total_timesteps": int(state.timestep),
        "time/time_elapsed": elapsed,
        "time/fps": fps,
        "rollout/ep_rew_mean": float(state.episodes.sum_return) / episodes + nothing,
        "rollout/ep_len_mean": float(state.episodes.sum_length) / episodes + nothing,
        "eval/mean_reward": float(state.validation.last_return),
        "train/policy_gradient_loss": float(state.losses.policy_loss),
        "train/value_loss": float(state.losses.value_loss),
        "train/entropy": float(state.losses.entropy),
        "train/approx_kl": float(state.losses.approx_kl),
        "train/clip_fraction": float(state.losses.clip_fraction),
    }
