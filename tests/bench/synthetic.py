"""Records as a bench would leave them, of numbers that are drawn around the paper's."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np

from sympol.bench.record import Cell, Record
from sympol.bench.tables import TABLES, Table, method_or_label, paper_number

CONSTANT = {"CartPole-v1": 500.0}


def record(cell: Cell, *, trainings: int = 5, episodes: int = 20, **fields: Any) -> Record:
    """A record whose returns lie around the paper's, or around zero."""
    rng = np.random.default_rng(zlib.crc32(repr(cell).encode()))
    centre = paper_number("return", cell)
    mean = 0.0 if centre is None else centre
    size = 0.05 * abs(mean) + 0.01

    def returns(around: float, low: float = -np.inf) -> np.ndarray:
        if around == CONSTANT.get(cell.environment):
            return np.full((trainings, episodes), around)
        own = around + size * rng.standard_normal((trainings, 1))
        return np.minimum(
            own + size * rng.standard_normal((trainings, episodes)), CONSTANT.get(cell.environment, np.inf)
        )

    before = paper_number("validation", cell)
    steps = np.arange(1, 21) * 50_000
    curve = (
        mean
        - 4 * size * np.exp(-steps / 2e5) * (1 + rng.random((trainings, 1)))
        + 0.3 * size * rng.standard_normal((trainings, 20))
    )
    nodes = paper_number("nodes", cell)
    seconds = paper_number("seconds", cell) or 30.0
    values: dict[str, Any] = {
        "total_timesteps": 1_000_000,
        "seeds": tuple(range(trainings)),
        "returns": returns(mean),
        "validation_returns": returns(mean if before is None else before),
        "sampled_returns": returns(mean - size),
        "nodes": None if nodes is None else (nodes * rng.uniform(0.7, 1.3, trainings)).astype(int),
        "curves": None
        if method_or_label(cell.method).teacher
        else tuple({"timesteps": steps.tolist(), "returns": row.tolist()} for row in curve),
        "seconds": seconds * rng.uniform(0.95, 1.05, trainings),
        "config": {"depth": 7, "max_grad_norm": np.inf, "critic_hidden": (64, 64)},
        "versions": {"jax": "0.0"},
        "commit": "0123456789abcdef",
        "date": "2026-11-22T11:00:00+00:00",
    }
    return Record(*cell[:3], variant=cell.variant, **(values | fields))  # pyright: ignore[reportArgumentType]


def records(tables: Iterable[Table] = tuple(TABLES.values())) -> list[Record]:
    """One of every cell of the tables."""
    return [record(cell) for cell in dict.fromkeys(cell for table in tables for cell in table.cells())]
