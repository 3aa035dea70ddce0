"""The command that says why a tree acts as it does, explain."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import tyro

from ..play import play
from ..trees import DecisionTree
from ..trees.boxes import space
from ..trees.explain import Norm, explanation_features, feature_indices
from ..trees.name_lookup import position
from .arguments import Folder, PlaysRun
from .console import one_line_errors, out
from .parse import parse
from .tree_io import spec_from, tree_from

MOST_LINES = 12
_NEGATIVE = re.compile(r"-[0-9.][0-9.eE+-]*")


@dataclass
class Explain(PlaysRun):
    """Why a tree acts as it does in one observation, and what would have to be different for another action.

    In a state that is written down: sympol explain RUN --observation 0 0.1 -0.2 0

    Feature by feature, the others near zero: sympol explain RUN --observation "pole angle=0.1" front=lava

    In a state of a test episode: sympol explain RUN --episode 7 --step 20
    """

    tree: Folder
    """A run's folder, a policy.json, or a listing in a .txt."""

    observation: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NUMBER ... | NAME=VALUE ...")] = ()
    """All its numbers, or some features (and groups, by category) by name."""

    episode: int | None = None
    """The seed of a test episode: the first one of sympol eval and sympol watch with that seed."""

    step: int = 0
    """The step of --episode to explain, from 0."""

    immutable: tuple[str, ...] = ()
    """Features and groups that cannot be different."""

    norm: Norm = "l1"
    """How far observations are apart: the sum of differences, how many there are, or the largest."""

    scale: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=NUMBER ...")] = ()
    """How much of a feature is as far as 1 of another; 1 where it is not given."""

    json: bool = False
    """One line of JSON."""


@one_line_errors()
def explain(arguments: Sequence[str]) -> int:
    """``sympol explain``."""
    # -1e-3 is a number, which a parser of arguments takes for a flag; after a space it does not
    given = parse(Explain, "explain", [f" {a}" if _NEGATIVE.fullmatch(a) else a for a in arguments])
    tree = tree_from(given.tree)
    explained = tree.explain(
        _observation(given, tree), immutable=given.immutable, norm=given.norm, scale=_scales(given.scale)
    )
    if given.json:
        print(json.dumps(explained.to_dict(), allow_nan=False))
        return 0
    lines = str(explained).split("\n")
    for line in lines[:MOST_LINES]:
        out.print(line, markup=False)
    if (more := len(lines) - MOST_LINES) > 0:
        out.print(f"… and {more} more actions; all of them: --json")
    return 0


def _observation(given: Explain, tree: DecisionTree) -> np.ndarray:
    if (given.episode is None) == (not given.observation):
        raise ValueError("give either --observation or --episode: what is to be explained?")
    if given.episode is not None:
        return _visited(given, tree, given.episode)
    if any("=" in word for word in given.observation):
        return _named(given.observation, tree)
    return np.array([_number(word, "--observation") for word in given.observation])


def _visited(given: Explain, tree: DecisionTree, seed: int) -> np.ndarray:
    if seed < 0 or given.step < 0:
        raise ValueError(f"--episode and --step must not be negative, got {seed} and {given.step}")
    seen = play(tree, spec_from(given.tree, tree, given), 1, seed=seed).observations
    if given.step >= len(seen):
        raise ValueError(
            f"--step must be from 0 to {len(seen) - 1} in the episode of seed {seed}, got {given.step}"
        )
    return seen[given.step]


def _named(words: Sequence[str], tree: DecisionTree) -> np.ndarray:
    """An observation near zero, with some features and groups as they are said to be."""
    x, features = space(tree, bounds=True).some_observation().astype(np.float64), explanation_features(tree)
    for word in words:
        name, equals, value = word.rpartition("=")
        if not equals:
            raise ValueError(f"--observation must be all numbers or all NAME=VALUE, got {word!r}")
        feature = features[feature_indices(tree, features, [name]).pop()]
        if feature.group is None:
            x[feature.positions[0]] = _number(value, f"the value of {name!r}")
        else:
            x[list(feature.positions)] = 0
            x[feature.positions[position(value, feature.group.categories, "category")]] = 1
    return x


def _scales(words: Sequence[str]) -> dict[str | int, float]:
    scales: dict[str | int, float] = {}
    for word in words:
        name, equals, value = word.rpartition("=")
        if not equals:
            raise ValueError(f"--scale must be of the form NAME=NUMBER, as in 'pole angle=0.1', got {word!r}")
        scales[name] = _number(value, f"the scale of {name!r}")
    return scales


def _number(word: str, what: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise ValueError(f"{what} must be a number, got {word!r}") from None
