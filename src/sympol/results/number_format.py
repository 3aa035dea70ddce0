"""Numbers in words, as tables and plots have them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .statistics import Interval, Moments


def number(value: float, places: int) -> str:
    """With a true minus, and no minus before zero."""
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:,.{places}f}"
    return text.replace("-", "−" if float(text.replace(",", "")) else "")


def spread(of: Moments, places: int) -> str:
    """Mean ± standard deviation over trainings; a single training has only its mean."""
    mean = number(of.mean, places)
    return mean if of.std is None else f"{mean} ± {number(of.std, places)}"


def interval(of: Interval, places: int = 2) -> str:
    """An estimate with its confidence interval."""
    return f"{number(of.estimate, places)} [{number(of.low, places)}, {number(of.high, places)}]"


def given(value: float) -> str:
    """A number with the decimals that its source prints."""
    return f"{value:,}".replace("-", "−")


def count(value: float) -> str:
    """A number of steps, short: 250 k, 1 M."""
    for unit, name in ((1e6, " M"), (1e3, " k")):
        if value >= unit:
            return f"{value / unit:g}{name}"
    return f"{value:g}"
