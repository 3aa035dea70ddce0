"""The scaling of observations: a map of each feature, fixed before training, which `TreePolicy.to_tree` undoes."""

from __future__ import annotations

from collections.abc import Sequence

import gymnasium
import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from gymnasium.spaces.utils import flatdim
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor  # pyright: ignore[reportMissingImports]
from torch import Tensor  # pyright: ignore[reportMissingImports]

from ..envs.host import advance, begin, too_large
from ..envs.spaces import LARGEST, Features
from ..functional.float32_order import UNDERFLOW
from ..functional.spread import LARGEST_SCALE, moves
from .torch_tree import flush


class ScaledFeatures(BaseFeaturesExtractor):
    """An observation as a row of numbers in the order of `sympol.envs.spaces.Features`: (x − shift) · scale.

    The rounding is that of sympol's training, with subnormal numbers zero, so that a threshold has one float32 in raw
    units that splits alike (`sympol.functional.float32_order.unscale_thresholds`).
    """

    shift: Tensor
    scale: Tensor

    def __init__(
        self, observation_space: gymnasium.Space, shift: Sequence[float], scale: Sequence[float]
    ) -> None:
        super().__init__(observation_space, flatdim(observation_space))
        for name, numbers in (("shift", shift), ("scale", scale)):
            array = torch.tensor(numbers, dtype=torch.float32)
            if array.shape != (self.features_dim,) or not array.isfinite().all():
                raise ValueError(
                    f"{name} must be {self.features_dim} finite numbers, one for each feature, got {list(numbers)}; "
                    "warm_up(env) finds them"
                )
            self.register_buffer(name, flush(array))
        if not (self.scale > 0).all():
            raise ValueError(f"scale must be positive, got {self.scale.tolist()}")

    def forward(self, observations: Tensor | dict[str, Tensor]) -> Tensor:
        """Features [batch, F] of an observation as stable-baselines3 has preprocessed it."""
        parts = observations.values() if isinstance(observations, dict) else [observations]
        x = flush(torch.cat([part.flatten(1) for part in parts], dim=1))
        product = flush(x - self.shift).double() * self.scale.double()  # 48 bits: exact
        return torch.where(product.abs() < UNDERFLOW, 0.0, product).float()


def warm_up(env: str | gymnasium.Env, num_steps: int = 2048, *, seed: int = 0) -> dict[str, list[float]]:
    """Find a scaling from random actions: ``policy_kwargs={"depth": 5, **warm_up("CartPole-v1")}``.

    What moves gets mean 0 and standard deviation ½, as in sympol's own training: thresholds then start where the
    observations are. An environment that is given as an object is reset, and left in the middle of an episode.

    Args:
        env: An id, or a Gymnasium environment.
        num_steps: Number of random actions.
        seed: Seeds the environment and the actions.

    Returns:
        ``shift`` and ``scale``, each with one number for each feature.

    Raises:
        ValueError: no steps, a space that a tree cannot have, or an observation too large to be scaled.
    """
    if num_steps < 1:
        raise ValueError(f"num_steps must be at least 1, got {num_steps}")
    made = gymnasium.make(env) if isinstance(env, str) else env
    features = Features.of(made.observation_space)
    made.action_space.seed(seed)
    observation = begin(made, seed=seed)
    seen = [observation]
    for _ in range(num_steps):
        observation, _, terminated, truncated = advance(made, made.action_space.sample())
        if terminated or truncated:
            observation = begin(made)
        seen.append(observation)
    if isinstance(env, str):
        made.close()
    flat = features.flatten_each(seen)
    beyond = [
        name for name, x in zip(features.names, flat.T, strict=True) if not (np.abs(x) <= LARGEST).all()
    ]
    if beyond:
        raise ValueError(too_large(beyond))
    return scaling(features, flat)


def scaling(features: Features, seen: np.ndarray) -> dict[str, list[float]]:
    """Shift and scale of each feature: by mean and spread where it moved in ``seen``, else by its bounds, else none."""
    with np.errstate(invalid="ignore"):
        middle, half = (features.low + features.high) / 2, (features.high - features.low) / 2
    bounded = np.isfinite(half) & (half > 0)
    seen = seen.astype(np.float64)
    mean, std = seen.mean(axis=0), seen.std(axis=0)
    moved = moves(seen.min(axis=0), seen.max(axis=0))
    shift = np.where(moved, mean, np.where(bounded, middle, 0))
    scale = np.where(moved, 0.5 / np.where(moved, std, 1), 1 / np.where(bounded, half, 1))
    scale = np.minimum(scale, LARGEST_SCALE)
    return {"shift": shift.astype(np.float32).tolist(), "scale": scale.astype(np.float32).tolist()}
