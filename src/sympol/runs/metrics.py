"""What happened during training, a row a validation: a CSV file, and TensorBoard where it is asked for.

The names are stable-baselines3's.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .checkpoint import write_atomically

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
        row = [f"{metrics[name]:.6g}" if name != COLUMNS[0] else metrics[name] for name in COLUMNS]
        with open(self._path, "a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([COLUMNS, row] if new else [row])

    def read(self) -> list[dict[str, float]]:
        """All rows, but for one that a kill cut short."""
        return [dict(zip(COLUMNS, map(float, line.split(",")), strict=True)) for line in self._lines()]

    def forget_after(self, timestep: int) -> None:
        """Drop the rows beyond a checkpoint that training resumes from."""
        if not self._path.exists():
            return
        kept = [line for line in self._lines() if int(line.split(",")[0]) <= timestep]
        if kept:
            lines = [",".join(COLUMNS), *kept]
            write_atomically(self._path, "".join(f"{line}\r\n" for line in lines).encode())
        else:
            self._path.unlink()

    def _lines(self) -> list[str]:
        """The rows that are whole, as they were written."""
        if not self._path.exists():
            return []
        text = self._path.read_bytes().decode("utf-8", "replace")
        whole = text[: text.rfind("\n") + 1].splitlines()
        return [line for line in whole[1:] if _is_row(line)]


def _is_row(line: str) -> bool:
    values = line.split(",")
    try:
        return len(values) == len(COLUMNS) and int(values[0]) >= 0 and bool([float(v) for v in values])
    except ValueError:
        return False


class TensorBoard:
    """The same numbers as TensorBoard scalars."""

    def __init__(self, folder: Path) -> None:
        self._writer: Any = self.require()(str(folder))

    @staticmethod
    def require() -> Any:
        """The writer's class. Raises ImportError where it is not installed."""
        try:
            from tensorboardX import SummaryWriter
        except ImportError as error:
            raise ImportError(
                "TensorBoard logs need tensorboardX: pip install 'sympol[tensorboard]'"
            ) from error
        return SummaryWriter

    def append(self, metrics: Mapping[str, float]) -> None:
        """Write one point of every curve."""
        step = int(metrics[COLUMNS[0]])
        for name in COLUMNS[1:]:
            self._writer.add_scalar(name, metrics[name], step)
        self._writer.flush()

    def close(self) -> None:
        """Flush and close."""
        self._writer.close()
