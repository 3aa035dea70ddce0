"""The budget of a search: environment steps, seconds, or both."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Budget:
    """A limit on a search, which ends as soon as either part is spent."""

    steps: float = math.inf
    """Environment steps."""
    seconds: float = math.inf
    """Seconds of wall-clock time."""
