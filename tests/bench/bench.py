"""A bench so small that it is over in seconds: tiny trainings on CartPole."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sympol.bench.methods import Settings
from sympol.bench.plan import CellPlan, cells_of, plan_cells, selected, tables_of
from sympol.bench.record import Record, load_all
from sympol.bench.run import run
from sympol.bench.summary import by_cell
from sympol.distill import METHODS, viper

from ..tiny import TINY

SETTINGS = Settings(total_timesteps=TINY["total_timesteps"], episodes=3)
METHODS_RUN = ("tree", "mlp", "sa-dt-5", "viper-5")


def tiny_preset(env: str, name: str, *, policy: str, algorithm: str, **_: Any) -> dict[str, Any]:
    """In place of all presets."""
    shared = {key: value for key, value in TINY.items() if key not in ("depth", "total_timesteps")}
    return {**shared, **({"actor_hidden": (8,)} if policy == "mlp" else {"depth": 3})}


def quick_viper(
    teacher: Any, depth: int = 5, num_iterations: int = 2, episodes_per_iteration: int = 2, seed: int = 0
) -> Any:
    return viper(teacher, depth, num_iterations, episodes_per_iteration, num_validation_episodes=2, seed=seed)


@pytest.fixture(autouse=True, scope="module")
def tiny_bench() -> Iterator[None]:
    """Import it where it is wanted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sympol.agents.preset", tiny_preset)
        patch.setitem(METHODS, "viper", quick_viper)  # pyright: ignore[reportArgumentType]
        yield


def plans(
    root: Path,
    methods: tuple[str, ...] = METHODS_RUN,
    *,
    settings: Settings = SETTINGS,
    trainings: int = 2,
    environment: str = "CartPole-v1",
) -> list[CellPlan]:
    tables = [selected(table, [environment], methods) for table in tables_of("viper-control")]
    return plan_cells(
        cells_of(tables), by_cell(load_all(root)), settings, range(trainings), root / "runs" / "bench"
    )


def bench(root: Path, *methods: str, **options: Any) -> dict[str, Record]:
    """Run what is missing; return all records by method."""
    todo = plans(root, methods or METHODS_RUN, **options)
    assert run(todo, root=root, runs=root / "runs" / "bench", progress=False) == []
    return records(root)


def records(root: Path) -> dict[str, Record]:
    return {record.method: record for record in load_all(root)}


def todo(root: Path, *methods: str, **options: Any) -> dict[str, list[int]]:
    """Which seeds of which methods are to be run."""
    return {
        plan.cell.method: [unit.seed for unit in plan.units]
        for plan in plans(root, methods or METHODS_RUN, **options)
        if plan.units
    }
