"""Methods of a user's own, as `sympol bench` imports them, in this process and in workers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sympol import DecisionTree
from sympol.envs.spec import EnvSpec

POLE_VELOCITY = 3


def by_hand(spec: EnvSpec, *, seed: int, total_timesteps: int, folder: Path) -> DecisionTree:
    """Push to where the pole falls."""
    return DecisionTree.from_complete(
        [POLE_VELOCITY], [0.0], [[1, 0], [0, 1]], actions=spec.actions, feature_names=spec.features.names
    )


def leftwards(spec: EnvSpec, *, seed: int, total_timesteps: int, folder: Path):
    """A policy that is no tree."""
    (folder / "told.txt").write_text(f"{spec.name} {seed} {total_timesteps}")
    return lambda x: np.zeros(len(x), int)


def fails_first(spec: EnvSpec, *, seed: int, total_timesteps: int, folder: Path):
    """Seed 1 fails, until somebody has repaired it."""
    if seed == 1 and not (folder.parent / "repaired").exists():
        raise RuntimeError("seed 1 is broken")
    return lambda x: np.ones(len(x), int)
