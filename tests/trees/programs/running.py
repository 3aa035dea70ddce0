"""Trees of every kind, and how a program made of one is run and compared with it."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sympol.trees import BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.export import FORMATS
from sympol.trees.export.check import run

from ..samples import ACTIONS, HOSTILE_NAMES, chain, random_grouped_tree, random_tree, telling_observations

RUNNABLE = [to for to, form in FORMATS.items() if form.runner]
PROGRAMS: list[tuple[str, dict[str, str]]] = [
    ("python", {}),
    ("c", {"style": "ifs"}),
    ("c", {"style": "table"}),
    ("rust", {}),
    ("javascript", {"style": "ifs"}),
    ("javascript", {"style": "table"}),
    ("sql", {"style": "sqlite"}),
    ("onnx", {}),
    ("treelite", {}),
]
IDS = ["-".join((to, *options.values())) for to, options in PROGRAMS]
PER_TREE = 84_000
TRAINED = Path(__file__).parents[2] / "golden" / "trees" / "trained_cartpole.json"
STRANGE = [
    *HOSTILE_NAMES,
    "*/ int x = ;", "/* // */", "?>", "ends in \\", "\\\n#error", "??/", "what??!", "</script><!--", "<script>",
    "'; DROP TABLE observations; --", '"; DROP TABLE observations; --', "`${process.exit(1)}`", "]]>", "-->",
    "%s%n{0}{tree}", "#include <nothing>", "\\u000a", "x0", "if", "act", "o", "action", "é" * 40,
]  # fmt: skip


@cache
def trees() -> dict[str, DecisionTree]:
    """One tree of each kind that a program could get wrong: twelve, so that they see a million observations."""
    rng = np.random.default_rng(20)
    discrete = ACTIONS["discrete"]
    far = DiscreteActions(3, start=2**23)  # as far as Treelite counts
    return {
        "trained": DecisionTree.from_json(TRAINED.read_text()),
        "leaf": random_tree(rng, discrete, depth=0),
        "one comparison": random_tree(rng, far, depth=1),
        **{kind: random_tree(rng, actions, depth=5) for kind, actions in ACTIONS.items()},
        **{f"grouped {kind}": random_grouped_tree(rng, ACTIONS[kind], 5, (4, 1, 3), 2) for kind in ("discrete", "box")},
        "chain to the left": chain(200, to_left=True, actions=discrete),
        "chain to the right": chain(200, to_left=False, actions=discrete),
        "255 nodes": random_tree(rng, ACTIONS["multi_discrete"], depth=7, n_features=20),
        "2047 nodes": random_tree(rng, discrete, depth=10, n_features=5),
    }  # fmt: skip


@cache
def seen(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Observations that the tree accepts, and what it does."""
    tree, rng = trees()[name], np.random.default_rng(21)
    x = telling_observations(tree, rng, PER_TREE)
    for group in tree.groups:
        x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=len(x))]
    return x, tree.predict(x).reshape(len(x), -1)


def ran(tree: DecisionTree, to: str, x: np.ndarray, **options: Any) -> np.ndarray:
    """Run a program, or skip where its compiler is not there."""
    try:
        return run(tree, to, x, **options).actions
    except FileNotFoundError as error:
        pytest.skip(str(error))


def same(acted: np.ndarray, expected: np.ndarray, to: str) -> bool:
    """Bit for bit; to SQL and Treelite, which add or have no -0.0, zero has no sign."""
    if to in ("sql", "treelite"):
        return acted.shape == expected.shape and (acted == expected).all()
    return acted.shape == expected.shape and acted.astype(expected.dtype).tobytes() == expected.tobytes()


@cache
def strange_trees() -> list[DecisionTree]:
    """Trees whose every name is a stranger's, one for each kind of actions and one with a group."""
    n = len(STRANGE)
    rng = np.random.default_rng(24)
    made = [
        DiscreteActions(n, tuple(STRANGE)),
        MultiDiscreteActions((2,) * n, tuple(STRANGE), tuple((name, "plain") for name in STRANGE)),
        BoxActions((-1,) * n, (1,) * n, (n,), tuple(STRANGE)),
    ]
    # a comparison for each name
    depth = math.ceil(math.log2(n + 1))
    feature = np.resize(np.arange(n), 2**depth - 1)
    threshold, values = (
        rng.normal(size=len(feature)),
        [rng.normal(size=(2**depth, a.n_outputs)) for a in made],
    )
    return [
        DecisionTree.from_complete(feature, threshold, value, actions=actions, feature_names=STRANGE)
        for actions, value in zip(made, values, strict=True)
    ] + [
        DecisionTree.from_complete(
            feature,
            np.where(feature < n // 2, threshold, 0.5),
            values[0],
            actions=made[0],
            feature_names=STRANGE,
            groups=[
                Group(STRANGE[i], tuple(range(i, n, 2)), tuple(STRANGE[i::2]))
                for i in (n - n % 2 - 2, n - n % 2 - 1)
            ],
        )
    ]


def with_start(start: int) -> DecisionTree:
    return DecisionTree.from_complete(
        np.array([0]), np.zeros(1), np.eye(2), actions=DiscreteActions(2, start=start), feature_names=["x"]
    )
