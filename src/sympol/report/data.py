"""The data of a run that the pages show: its policy, its test episodes, its properties."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..agents import Agent, load_run
from ..play import Episodes
from ..runs.formatting import format_return
from ..runs.run import Run
from ..trees import DecisionTree
from ..trees.floats import printable
from ..trees.report import packed

FILE = "safety.toml"


def properties_of(run: Run, given: Path | None) -> Path | None:
    """Return the file of properties: the one given, or the one in the run's folder, if there is one."""
    own = run.path / FILE
    return given or (own if own.is_file() else None)


def checks_data(tree: DecisionTree, file: Path) -> list[dict[str, Any]]:
    """Prove or refute the properties in a file.

    Args:
        tree: The tree.
        file: The file of properties.

    Returns:
        The verdicts, as data of a page.

    Raises:
        ValueError: The file holds something else than properties of this tree.
        OSError: It cannot be read.
    """
    return [
        {
            "name": printable(verdict.name),
            "rule": printable(verdict.rule),
            "holds": verdict.holds,
            "words": printable(verdict.words),
            "counterexample": None if verdict.counterexample is None else packed(verdict.counterexample),
        }
        for verdict in tree.verify(file)
    ]


def policy_of(run: Run) -> Agent | DecisionTree:
    """Return the policy of a run: its tree, or the agent if its policy is no tree.

    Raises:
        RunError: There is no policy yet, or it cannot be read.
    """
    return run.load_tree() if run.has_tree else load_run(run)


def check_test(episodes: int, seed: int) -> None:
    """Refuse impossible test episodes.

    Raises:
        ValueError: There are none, or their seed is negative.
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")


def tests_data(tested: Episodes, seed: int) -> dict[str, Any]:
    """Return the returns of test episodes, one by one and in all, as data of a page."""
    mean, std = float(tested.returns.mean()), float(tested.returns.std())
    return {
        "returns": [round(float(x), 6) for x in tested.returns],
        "mean": mean,
        "words": format_return(mean, std),
        "steps": float(tested.lengths.mean()),
        "seed": seed,
    }
