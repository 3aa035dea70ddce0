"""Which nodes a condition is about, against all cells there are."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from sympol.trees import DecisionTree
from sympol.trees.override import nodes_reached_by

from .samples import ACTIONS, consistent, random_grouped_tree, random_tree

ASKS = np.float32([-1, 0, 0.25, 0.5])


def every_cell(tree: DecisionTree) -> np.ndarray:
    """One observation in each cell of the grid of all thresholds and of the numbers that conditions ask for."""
    axes = []
    for feature in range(tree.n_features):
        if feature in tree.group_of:
            axes.append(np.float32([0, 1]))
            continue
        t = np.unique(np.concatenate([tree.threshold[tree.feature == feature], ASKS]))
        above = np.where(t == 0, np.finfo(np.float32).smallest_normal, np.nextafter(t, np.float32(np.inf)))
        axes.append(np.concatenate([t, above, np.float32([-np.inf, np.inf, np.nan])]))
    return consistent(tree, np.array(list(product(*map(np.unique, axes))), np.float32))


@pytest.mark.parametrize("seed", range(8))
def test_exactly_the_nodes_that_meet_it(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, ACTIONS["discrete"], depth=3, n_features=2)
    x = every_cell(tree)
    some = 0
    for a, b in product(ASKS, ASKS):
        for condition, holds in {
            f"x[0] > {a}": ~(x[:, 0] <= a),
            f"x[0] <= {a} and x[1] > {b}": (x[:, 0] <= a) & ~(x[:, 1] <= b),
            f"x[0] <= {a} or x[1] <= {b}": (x[:, 0] <= a) | (x[:, 1] <= b),
        }.items():
            met = tree.decision_path(x[holds]).any(axis=0)
            assert nodes_reached_by(tree, condition) == tuple(np.flatnonzero(met)), condition
            some += 0 < met.sum() < tree.n_nodes
    assert some > 10


def test_a_category_rules_the_others_out():
    tree = random_grouped_tree(np.random.default_rng(1), ACTIONS["discrete"], sizes=(3,), n_free=1)
    group, x = tree.groups[0], every_cell(tree)
    for feature, category in zip(group.features, group.categories, strict=True):
        met = tree.decision_path(x[x[:, feature] == 1]).any(axis=0)
        assert nodes_reached_by(tree, f"{group.name} is {category}") == tuple(np.flatnonzero(met))


@pytest.mark.parametrize(
    ("condition", "says"),
    [
        ("y > 1", "y"),
        ("x[0] > 1 and x[0] <= 0", "no observation meets"),
        ("x[0] >", "number"),
        ("", "expected"),
    ],
)
def test_a_condition_that_is_none_is_refused(condition, says):
    with pytest.raises(ValueError, match=says):
        nodes_reached_by(random_tree(np.random.default_rng(0), ACTIONS["discrete"]), condition)
