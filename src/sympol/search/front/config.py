"""The configuration of a search: read from the command line, kept in its folder."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ...algorithms.presets import ANY, search_defaults
from ...counts import NUMBER, parse_count

SHARES: dict[str, float] = search_defaults(ANY)["shares"]
"""The budget's division among methods; those of a search share all of it except what selection takes."""
SELECTION = 0.1
"""The part of a budget in seconds that is set aside for selection and the test."""
MIN_SECONDS = 10.0
"""The smallest budget in seconds: compiling takes that long."""
MIN_STEPS = 50_000
"""The smallest budget in environment steps of each training and of each evolution."""
_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True)
class SearchConfig:
    """The settings of one search.

    Raises:
        ValueError: A limit that is even or below 1, no method or an unknown one, a number below its minimum, or a
            budget that is malformed or too small.
    """

    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"roads": "methods"}

    env: str
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    max_nodes: int = 63
    budget: str = ""
    """A time or a number of environment steps, such as "5m" or "50M steps"; by default that of the preset.

    Trainings, fine-tuning and evolution end with it. Distillation, pruning and selection are always finished, and may
    take more.
    """
    methods: tuple[str, ...] = tuple(SHARES)
    """The methods, always in the order of `SHARES`: evolution starts from the candidates of the others."""
    teacher: str = ""
    """A run's folder or a stable-baselines3 zip to distil, in place of an MLP that is trained for it."""
    trainings: int = 2
    """The number of trainings from scratch."""
    teachers: int | None = None
    """The number of teachers, or of distillations of the one that is given; by default that of the preset."""
    islands: int = 2
    """The number of independent searches by evolution."""
    eval_episodes: int = 100
    """Test episodes of each tree of the front, on Gymnasium."""

    def __post_init__(self) -> None:
        """Fill in defaults of the preset, and check."""
        if not self.methods or not {*self.methods} <= SHARES.keys():
            raise ValueError(
                f"methods must be some of {', '.join(SHARES)}, got {', '.join(self.methods) or 'none'}"
            )
        object.__setattr__(self, "methods", tuple(method for method in SHARES if method in self.methods))
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
        runs = {method: self.number(method) * (2 if method == "teacher" else 1) for method in self.methods}
        least = max(MIN_STEPS * runs[method] / self.share(method) for method in self.methods)
        if self.seconds < MIN_SECONDS or self.steps < least:
            raise ValueError(
                f"budget is too small for one run: {self.budget!r}; give at least {MIN_SECONDS:.0f}s or "
                f"{int(np.ceil(least / 1000))}k steps, or fewer methods, trainings or islands"
            )

    @property
    def seconds(self) -> float:
        """Seconds of the whole search; infinite where steps are counted."""
        return _read(self.budget)[0]

    @property
    def steps(self) -> float:
        """Environment steps of all methods together; infinite where seconds are counted."""
        return _read(self.budget)[1]

    def number(self, method: str) -> int:
        """Return the number of tasks of a method.

        Args:
            method: One of `SHARES`.

        Returns:
            How many independent tasks it has.
        """
        assert self.teachers is not None
        return {"scratch": self.trainings, "teacher": self.teachers, "evolve": self.islands}[method]

    def share(self, method: str) -> float:
        """Return the part of the budget that a method has.

        Args:
            method: One of the methods of this search.

        Returns:
            A part between 0 and 1, of all its tasks together.
        """
        shares = search_defaults(self.env)["shares"]
        return (1 - SELECTION) * shares[method] / sum(shares[other] for other in self.methods)


def steps_of(budget: str) -> float:
    """Return the environment steps of a budget.

    Args:
        budget: A budget as of `SearchConfig`, or another text.

    Returns:
        Its steps; infinite where it is a time, or no budget.
    """
    try:
        return _read(budget)[1]
    except ValueError:
        return math.inf


def _read(budget: str) -> tuple[float, float]:
    """Return seconds and steps; one of them is infinite."""
    match = re.fullmatch(rf"({NUMBER})\s*(?:(s|m|h)|([kKMG]?)\s*steps)", budget.strip(), re.ASCII)
    if match is None or match[1].startswith("-") or not float(match[1].replace(",", "")):
        raise ValueError(
            f"budget must be a time, such as 90s, 5m or 1h, or environment steps, such as '50M steps', got {budget!r}"
        )
    if match[2]:
        return float(match[1].replace(",", "")) * _UNITS[match[2]], math.inf
    try:
        return math.inf, float(parse_count(match[1] + match[3]))
    except ValueError as error:
        raise ValueError(f"the steps of a budget {error}") from None
