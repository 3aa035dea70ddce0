"""Numbers of a run in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..play import Episodes
from ..runs.progress import decimals


def tests_data(tested: Episodes, seed: int) -> dict[str, Any]:
    """The returns of test episodes, one by one and in all."""
    return {
        "returns": [round(float(x), 6) for x in tested.returns],
        "mean": float(tested.returns.mean()),
        "std": float(tested.returns.std()),
        "steps": float(tested.lengths.mean()),
        "seed": seed,
    }


def mean_words(tests: Mapping[str, Any]) -> str:
    """A mean return, with its standard deviation where it has one: ``475.3 ± 12.0``."""
    n = decimals(tests["mean"])
    return f"{tests['mean']:,.{n}f}" + (f" ± {tests['std']:,.{n}f}" if "std" in tests else "")
