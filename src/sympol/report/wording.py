"""Numbers of a run in words."""

from __future__ import annotations

from typing import Any

from ..play import Episodes
from ..runs.progress import decimals


def tests_data(tested: Episodes, seed: int) -> dict[str, Any]:
    """The returns of test episodes, one by one and in all."""
    mean, std = float(tested.returns.mean()), float(tested.returns.std())
    return {
        "returns": [round(float(x), 6) for x in tested.returns],
        "mean": mean,
        "words": return_words(mean, std),
        "steps": float(tested.lengths.mean()),
        "seed": seed,
    }


def return_words(mean: float, std: float | None = None) -> str:
    """A return, or a mean one with its standard deviation: ``475.3 ± 12.0``."""
    n = decimals(mean)
    return f"{mean:,.{n}f}" + ("" if std is None else f" ± {std:,.{n}f}")
