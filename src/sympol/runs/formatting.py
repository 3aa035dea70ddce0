"""Returns as text."""

from __future__ import annotations


def decimals(mean: float) -> int:
    """Return the number of decimals to write of a return: where it is about 1 (MiniGrid), the third still matters."""
    return 1 if abs(mean) >= 10 else 3


def format_return(mean: float, std: float | None = None) -> str:
    """Return a return as text, or a mean one with its standard deviation: ``475.3 ± 12.0``."""
    n = decimals(mean)
    return f"{mean:,.{n}f}" + ("" if std is None else f" ± {std:,.{n}f}")
