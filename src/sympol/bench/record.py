"""Records: a finished cell of a table as a small JSON file, with the returns of some trainings of one method.

Tables, plots and tests are functions of records and of nothing else.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from .. import files
from ..bounded import parse_json
from ..results.json_io import dumps, plain, rounded
from ..results.seeds import require_training_seed

Returns: TypeAlias = tuple[tuple[float, ...], ...]
"""Undiscounted returns ``[trainings, episodes]``."""

_DIGITS = 7
"""The significant digits of measured numbers in a file: those of float32."""
_MEASURED = ("returns", "validation_returns", "sampled_returns", "curves", "seconds")
_SLUG = re.compile(r"[a-z0-9][a-z0-9._+-]*")
_ENVIRONMENT = re.compile(r"\w[\w.:-]*(/\w[\w.:-]*)?")


class RecordError(ValueError):
    """A record with an impossible value; the message names the value, the rule and the remedy."""


class Cell(NamedTuple):
    """The identity of a cell of a table, unique among records."""

    environment: str
    algo: str
    method: str
    variant: str = ""


@dataclass(frozen=True)
class Record:
    """The results of one cell. Values of trainings are in the order of ``seeds``; too few seeds make a partial cell."""

    environment: str
    algo: Literal["ppo", "a2c"]
    method: str
    """The method's name: "tree", "mlp", "sa-dt-5", or your own."""
    total_timesteps: int
    """Environment steps of each training."""
    seeds: tuple[int, ...]
    """Seeds of the trainings, of `seeds.TRAINING`."""
    returns: Returns
    """Returns of test episodes, ``[trainings, episodes]``, played deterministically on Gymnasium."""
    variant: str = ""
    """The variant (`tables.VARIANTS`) of an ablation, or nothing."""
    validation_returns: Returns | None = None
    """Returns of the policy that was trained, for a post-hoc tree its teacher, ``[trainings, episodes]``. They are of
    validation episodes that selected nothing, played deterministically on Gymnasium."""
    sampled_returns: Returns | None = None
    """Returns of test episodes with sampled actions, ``[trainings, episodes]``."""
    nodes: tuple[int, ...] | None = None
    """Inner nodes and leaves of each training's tree after pruning."""
    curves: tuple[dict[str, list[float]], ...] | None = None
    """Each training's validations: "timesteps" and mean "returns"."""
    seconds: tuple[float, ...] | None = None
    """Seconds that each training took, without compiling; ``extra["load"]`` is the load of the machine."""
    config: dict[str, Any] = field(default_factory=dict)
    """Everything that decides the numbers but the seeds. With another config the record is stale (`same_config`)."""
    versions: dict[str, Any] = field(default_factory=dict)
    commit: str = ""
    date: str = ""
    """The time at which the cell was finished, in ISO 8601."""
    extra: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Convert plain values and check them; raises RecordError."""
        _check_names(self)
        shaped: dict[str, Any] = {"seeds": _seeds(self.seeds)}
        for name in ("returns", "validation_returns", "sampled_returns"):
            shaped[name] = _returns(name, getattr(self, name), len(self.seeds))
        for name, kind in (("nodes", int), ("seconds", float)):
            shaped[name] = _per_training(name, getattr(self, name), len(self.seeds), kind)
        shaped["curves"] = _curves(self.curves, len(self.seeds))
        for name in ("config", "versions", "extra"):
            shaped[name] = plain(getattr(self, name))
        for name, value in shaped.items():
            object.__setattr__(self, name, value)

    @property
    def cell(self) -> Cell:
        """The cell of the record."""
        return Cell(self.environment, self.algo, self.method, self.variant)

    def missing(self, seeds: Iterable[int]) -> tuple[int, ...]:
        """Return the ``seeds`` that the record lacks."""
        return tuple(seed for seed in seeds if seed not in self.seeds)

    def path(self, root: Path) -> Path:
        """Return the record's path below ``root``, the repository or another folder that holds ``results/``."""
        parts = (self.algo, self.method, *([self.variant] if self.variant else []))
        return cells_folder(root) / self.environment.replace("/", "_") / f"{'-'.join(parts)}.json"

    def save(self, root: Path) -> Path:
        """Write the record atomically, replacing an older one of the same cell, and return its path.

        Raises:
            RecordError: The path holds a record of another cell.
        """
        path = self.path(root)
        if path.exists() and (there := load(path).cell) != self.cell:
            raise RecordError(
                f"{path} holds {there}, which is another cell than {self.cell}; rename the variant"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        files.write(path, to_json(self))
        return path


def cells_folder(root: Path) -> Path:
    """Return the folder of all records."""
    return results_folder(root) / "cells"


def results_folder(root: Path) -> Path:
    """Return the folder of results: ``studies/results`` in a checkout of the repository, ``results`` elsewhere."""
    kept = root / "studies" / "results"
    return kept if kept.is_dir() else root / "results"


def load(path: Path) -> Record:
    """Read one record.

    Raises:
        RecordError: The file is not a record; the message names it.
    """
    try:
        values = parse_json(files.read_text(path), "it")
        known = [entry.name for entry in dataclasses.fields(Record)]
        if unknown := set(values) - set(known):
            raise RecordError(f"unknown fields {sorted(unknown)}; known are {', '.join(known)}")
        return Record(**values)
    except (ValueError, TypeError, KeyError) as error:
        raise RecordError(
            f"{path} is not a record: {error}; correct it, or remove it and run its cell again"
        ) from error


def load_all(root: Path) -> list[Record]:
    """Read all records below ``root``, in the order of their paths.

    Raises:
        RecordError: A file is not a record, or is in the wrong place.
    """
    records = []
    for path in sorted(cells_folder(root).glob("*/*.json")):
        record = load(path)
        if record.path(root) != path:
            raise RecordError(
                f"{path} holds {record.cell}, whose place is {record.path(root)}; move it there"
            )
        records.append(record)
    return records


def to_json(record: Record) -> str:
    """Return JSON with a line for each training, so that a version control system shows which one changed.

    Measured numbers are rounded to 7 significant digits; the config is exact.
    """
    fields = {entry.name: getattr(record, entry.name) for entry in dataclasses.fields(Record)}
    return dumps(
        {name: rounded(fields[name], _DIGITS) if name in _MEASURED else fields[name] for name in fields}
    )


def _check_names(record: Record) -> None:
    if not _ENVIRONMENT.fullmatch(record.environment):
        raise RecordError(f"environment must be an id as Gymnasium has them, got {record.environment!r}")
    if record.algo not in ("ppo", "a2c"):
        raise RecordError(f"algo must be ppo or a2c, got {record.algo!r}")
    for name in ("method", "variant"):
        slug = getattr(record, name)
        if not _SLUG.fullmatch(slug) and (name, slug) != ("variant", ""):
            raise RecordError(f"{name} must be of small letters, digits and '._+-', got {slug!r}")
    if not record.total_timesteps >= 1:
        raise RecordError(f"total_timesteps must be at least 1, got {record.total_timesteps}")


def _seeds(seeds: Iterable[int]) -> tuple[int, ...]:
    seeds = tuple(map(require_training_seed, seeds))
    if not seeds or len({*seeds}) < len(seeds):
        raise RecordError(
            f"seeds must be some, each once, got {list(seeds)}; a cell without trainings has no record"
        )
    return seeds


def _returns(name: str, returns: Any, trainings: int) -> Any:
    if returns is None:
        if name == "returns":
            raise RecordError("returns must be given; a cell that was not played has no record")
        return None
    rows = tuple(tuple(map(float, row)) for row in returns)
    if len(rows) != trainings or len({len(row) for row in rows}) != 1 or not rows[0]:
        raise RecordError(
            f"{name} must have {trainings} rows, one a seed, of equally many episodes; "
            f"got rows of {', '.join(str(len(row)) for row in rows) or 'none'}"
        )
    if not np.isfinite(rows).all():
        raise RecordError(
            f"{name} must be finite, got NaN or infinity: the environment is broken, or the policy"
        )
    return rows


def _per_training(name: str, values: Any, trainings: int, kind: type) -> tuple[Any, ...] | None:
    if values is None:
        return None
    if len(values) != trainings:
        raise RecordError(f"{name} must have one number a seed, {trainings}, got {len(values)}")
    if not all(math.isfinite(value) and value >= 0 for value in values):
        raise RecordError(f"{name} must be finite and not negative, got {list(values)}")
    return tuple(map(kind, values))


def _curves(curves: Any, trainings: int) -> tuple[dict[str, list[float]], ...] | None:
    if curves is None:
        return None
    if len(curves) != trainings:
        raise RecordError(f"curves must have one a seed, {trainings}, got {len(curves)}")
    for curve in curves:
        steps, returns = np.asarray(curve["timesteps"], float), np.asarray(curve["returns"], float)
        if steps.shape != returns.shape or np.any(np.diff(steps) <= 0) or not np.isfinite(returns).all():
            raise RecordError("a curve must have a finite return for each of its rising timesteps")
    return tuple({name: [*map(float, curve[name])] for name in ("timesteps", "returns")} for curve in curves)
