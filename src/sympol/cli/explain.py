"""``sympol explain``: why a tree acts as it does in one observation."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import tyro

from ..trees import DecisionTree
from ..trees.boxes import space
from ..trees.explain import Norm, explanation_features, feature_indices
from ..trees.name_lookup import position
from .arguments import Folder, PlaysRun, parse
from .console import out
from .tree_io import spec_from, tree_from

MOST_LINES = 12
_NEGATIVE = re.compile(r"-[0-9.][0-9.eE+-]*")


@dataclass
class Explain(PlaysRun):
    """Explain why a tree acts as it does in one observation, and what would change its action.

    A state by its numbers: sympol explain RUN --observation 0 0.1 -0.2 0

    Some features by name, the others near zero: sympol explain RUN --observation "pole angle=0.1" front=lava

    A state of a test episode: sympol explain RUN --episode 7 --step 20
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
    """Features and groups that must not change."""

    norm: Norm = "l1"
    """The distance between observations: the sum of differences (l1), their number (l0), or the largest (linf)."""

    scale: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=NUMBER ...")] = ()
    """The unit of a feature in distances; 1 by default."""

    json: bool = False
    """Print one line of JSON."""


def run(words: Sequence[str]) -> int:
    """Run ``sympol explain``."""
    # -1e-3 is a number, but argparse takes it for a flag unless a space is before it
    given = parse(Explain, "explain", [f" {a}" if _NEGATIVE.fullmatch(a) else a for a in words])
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
    from ..play import play

    seen = play(tree, spec_from(given.tree, tree, given), 1, seed=seed).observations
    if given.step >= len(seen):
        raise ValueError(
            f"--step must be from 0 to {len(seen) - 1} in the episode of seed {seed}, got {given.step}"
        )
    return seen[given.step]


def _named(words: Sequence[str], tree: DecisionTree) -> np.ndarray:
    """Return an observation near zero, with the named features and groups set."""
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
