"""The configuration of a search: read from the command line, kept in its folder."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Self

import numpy as np

from ...algorithms.presets import ANY, search_defaults

SHARES: dict[str, float] = search_defaults(ANY)["shares"]
"""The budget's division among methods; the chosen ones share all of it but what selection takes."""
CHOOSING = 0.1
"""Part of a budget in seconds for choosing and testing."""
LEAST_SECONDS = 10.0
"""Of a budget: what compiling takes."""
LEAST_STEPS = 50_000
"""For each training and each search by evolution."""
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}
_STEPS = {"k": 1e3, "M": 1e6, "G": 1e9, "": 1.0}


@dataclass(frozen=True)
class SearchConfig:
    """One search.

    Raises:
        ValueError: a limit that is even or below one, no method or an unknown one, a malformed budget.
    """

    env: str
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    max_nodes: int = 63
    budget: str = ""
    """A time or a number of environment steps, such as "5m" or "50M steps"; by default that of the preset."""
    methods: tuple[str, ...] = tuple(SHARES)
    """Taken in this order, whatever order they are given in: evolution starts from what the others found."""
    teacher: str = ""
    """A run's folder or a stable-baselines3 zip, in place of a teacher that is trained."""
    trainings: int = 2
    """From scratch."""
    teachers: int | None = None
    """Each trained, or distilled if one is given, with seeds of its own; by default that of the preset."""
    islands: int = 2
    """Searches by evolution, each with seeds of its own."""
    eval_episodes: int = 100
    """Of the test, on Gymnasium."""

    def __post_init__(self) -> None:
        """Check."""
        if not self.methods or not {*self.methods} <= SHARES.keys():
            raise ValueError(
                f"roads must be some of {', '.join(SHARES)}, got {', '.join(self.methods) or 'none'}"
            )
        object.__setattr__(self, "methods", tuple(road for road in SHARES if road in self.methods))
        object.__setattr__(self, "env_kwargs", dict(self.env_kwargs))
        if not self.budget:
            object.__setattr__(self, "budget", f"{search_defaults(self.env)['minutes']:g}m")
        if self.teachers is None:
            object.__setattr__(self, "teachers", search_defaults(self.env)["teachers"])
        if self.max_nodes < 1 or self.max_nodes % 2 == 0:
            near = f"{self.max_nodes - 1} or {self.max_nodes + 1}" if self.max_nodes > 1 else "1 or 3"
            raise ValueError(
                f"max_nodes must be odd and at least 1, got {self.max_nodes}: a tree has one leaf more than it has "
                f"splits; give {near}"
            )
        for name in ("trainings", "teachers", "islands"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        if self.eval_episodes < 2:
            raise ValueError(f"eval_episodes must be at least 2, got {self.eval_episodes}")
        self._check_budget()

    def _check_budget(self) -> None:
        _read(self.budget)
        runs = {road: self.number(road) * (2 if road == "teacher" else 1) for road in self.methods}
        least = max(LEAST_STEPS * runs[road] / self.share(road) for road in self.methods)
        if self.seconds < LEAST_SECONDS or self.steps < least:
            raise ValueError(
                f"budget is too small for one run: {self.budget!r}; give at least {LEAST_SECONDS:.0f}s or "
                f"{int(np.ceil(least / 1000))}k steps, or fewer roads, trainings or islands"
            )

    @property
    def seconds(self) -> float:
        """Seconds of the whole search; infinite where steps are counted."""
        return _read(self.budget)[0]

    @property
    def steps(self) -> float:
        """Environment steps of all methods together; infinite where seconds are counted."""
        return _read(self.budget)[1]

    def number(self, road: str) -> int:
        """Return the number of tasks of a method."""
        assert self.teachers is not None
        return {"scratch": self.trainings, "teacher": self.teachers, "evolve": self.islands}[road]

    def share(self, road: str) -> float:
        """Return the part of the budget that a method has."""
        shares = search_defaults(self.env)["shares"]
        return (1 - CHOOSING) * shares[road] / sum(shares[taken] for taken in self.methods)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain JSON."""
        values = asdict(self)
        values["roads"] = list(values.pop("methods"))
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a configuration of what `to_dict` returned; raises ValueError for unknown fields."""
        known = {part.name for part in fields(cls)} - {"methods"} | {"roads"}
        if not values.keys() <= known:
            raise ValueError(f"unknown fields {', '.join(sorted(values.keys() - known))}")
        values = dict(values)
        return cls(methods=tuple(values.pop("roads")), **values)


def _read(budget: str) -> tuple[float, float]:
    """Seconds and steps; one of them is infinite."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(?:(s|m|h)|([kMG]?)\s*steps)", budget.strip())
    if found is None or float(found[1]) == 0:
        raise ValueError(
            f"budget must be a time, such as 90s, 5m or 1h, or environment steps, such as '50M steps', got {budget!r}"
        )
    number = float(found[1])
    return (number * _UNITS[found[2]], math.inf) if found[2] else (math.inf, number * _STEPS[found[3]])
