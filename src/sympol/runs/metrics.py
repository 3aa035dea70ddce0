"""What happened during training, a row a validation: a CSV file, and TensorBoard where it is asked for.

The names are stable-baselines3's.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

COLUMNS = (
    "time/total_timesteps",
    "time/time_elapsed",
    "time/fps",
    "rollout/ep_rew_mean",
    "rollout/ep_len_mean",
    "eval/mean_reward",
    "train/policy_gradient_loss",
    "train/value_loss",
    "train/entropy",
    "train/approx_kl",
    "train/clip_fraction",
)


class MetricsFile:
    """An append-only CSV; every row is on disk when `append` returns."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one row."""
        new = not self._path.exists()
        with open(self._path, "a", newline="") as file:
            writer = csv.writer(file)
            if new:
                writer.writerow(COLUMNS)
            writer.writerow([f"{metrics[name]:.6g}" if name != COLUMNS[0] else metrics[name] for name in COLUMNS])

    def read(self) -> list[dict[str, float]]:
        """All rows."""
        if not self._path.exists():
            return []
        with open(self._path, newline="") as file:
            return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]

    def forget_after(self, timestep: int) -> None:
        """Drop the rows beyond a checkpoint that training resumes from."""
        rows = [row for row in self.read() if row[COLUMNS[0]] <= timestep]
        self._path.unlink(missing_ok=True)
        for row in rows:
            self.append({**row, COLUMNS[0]: int(row[COLUMNS[0]])})


class TensorBoard:
    """The same numbers as TensorBoard scalars."""

    def __init__(self, folder: Path) -> None:
        try:
            from tensorboardX import SummaryWriter
        except ImportError as error:
            raise ImportError("TensorBoard logs need tensorboardX: pip install 'sympol[tensorboard]'") from error
        self._writer: Any = SummaryWriter(str(folder))

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one point of every curve."""
        step = int(metrics[COLUMNS[0]])
        for name in COLUMNS[1:]:
            self._writer.add_scalar(name, metrics[name], step)
        self._writer.flush()

    def close(self) -> None:
        """Flush and close."""
        self._writer.close()
