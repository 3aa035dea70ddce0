"""Random trees, observations that try to tell them apart, and the plain loop that is always right."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from sympol.trees import ActionSpec, BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions

HOSTILE_NAMES = [
    'quote " and \' and """',
    "line\nbreak\r\x0c\x0b\x85\u2028",
    "'); raise SystemExit(1)  #",
    "$\\frac$ \\N{BULLET} \\",
    "</svg><script>alert(1)</script>--> ]]>",
    "{0} {x!r} %s",
    "\u202egnihton\ud800\x00",
    "",
]

ACTIONS: dict[str, ActionSpec] = {
    "discrete": DiscreteActions(3, ("left", "stay", "right"), start=-1),
    "multi_discrete": MultiDiscreteActions(
        (2, 3), ("gas", "steer"), (("off", "on"), ("left", "none", "right"))
    ),
    "box": BoxActions((-1.0, -0.5), (1.0, 0.5), (2, 1), ("gas", "steer")),
}
SPECIAL = np.float32([0, -0.0, 1e-40, -1e-40, 1.1754942e-38, 1.1754944e-38, -1.1754944e-38])


def random_tree(
    rng: np.random.Generator, actions: ActionSpec, depth: int = 4, n_features: int = 3
) -> DecisionTree:
    """Draw a complete tree with few different thresholds and actions, so that there is much to prune."""
    n_inner = 2**depth - 1
    grid = np.concatenate([rng.normal(size=6).astype(np.float32), SPECIAL])
    few_values = rng.normal(size=(3, actions.n_outputs))
    low, high = -rng.uniform(0, 2, n_features), rng.uniform(0, 2, n_features)
    bounded = rng.random(n_features) < 0.5
    tree = DecisionTree.from_complete(
        rng.integers(n_features, size=n_inner),
        rng.choice(grid, n_inner),
        few_values[rng.integers(3, size=n_inner + 1)]
        + rng.normal(size=(n_inner + 1, actions.n_outputs)) * 0.1,
        actions=actions,
        feature_low=np.where(bounded, low, -np.inf),
        feature_high=np.where(bounded, high, np.inf),
    )
    return tree.with_visits(rng.normal(size=(200, n_features)))


def random_grouped_tree(
    rng: np.random.Generator,
    actions: ActionSpec,
    depth: int = 4,
    sizes: tuple[int, ...] = (3, 2),
    n_free: int = 1,
) -> DecisionTree:
    """Draw a complete tree over groups of these sizes and free features, in any order of the features.

    Most splits ask the groups for categories, some ask them for numbers; bounds rule categories out, leave one,
    say nothing, or leave none.
    """
    n_features, n_inner = sum(sizes) + n_free, 2**depth - 1
    order = rng.permutation(n_features).tolist()
    groups = [
        Group(
            f"g{i}", tuple(order[sum(sizes[:i]) : sum(sizes[: i + 1])]), tuple(f"c{j}" for j in range(size))
        )
        for i, size in enumerate(sizes)
    ]
    grouped = np.isin(np.arange(n_features), [feature for group in groups for feature in group.features])
    feature = rng.integers(n_features, size=n_inner)
    asks = rng.choice(np.float32([0, -0.0, 0.25, 0.5, 0.99999994]), n_inner)
    asks = np.where(rng.random(n_inner) < 0.1, rng.choice(np.float32([-1, 1, 2]), n_inner), asks)
    usual = rng.choice([-np.inf, 0, 0, 0, 1e-3, 1], n_features, p=[0.1, 0.3, 0.3, 0.26, 0.02, 0.02])
    low = np.where(grouped, usual, rng.choice([-np.inf, -0.5, 0.25], n_features))
    high = np.where(rng.random(n_features) < 0.2, 0, rng.choice([1, 1, np.inf], n_features))
    high = np.where(grouped, high, rng.choice([np.inf, 0.5, 0.75], n_features))
    few_values = rng.normal(size=(3, actions.n_outputs))
    tree = DecisionTree.from_complete(
        feature,
        np.where(grouped[feature], asks, rng.choice(np.float32([-1, -0.5, 0, 0.25, 0.5, 1]), n_inner)),
        few_values[np.minimum(rng.geometric(0.5, n_inner + 1) - 1, 2)]
        + rng.normal(size=(n_inner + 1, actions.n_outputs)) * 0.1,
        actions=actions,
        feature_names=[f"x[{i}]" for i in range(n_features)],
        feature_low=low,
        feature_high=np.maximum(low, high),
        groups=groups,
    )
    everything = consistent(tree, every_cell(tree, nan=False))
    return tree.with_visits(rng.choice(everything, 100))


def telling_observations(tree: DecisionTree, rng: np.random.Generator, n: int) -> np.ndarray:
    """Draw observations on thresholds and bounds, beside them, anywhere, subnormal, infinite and NaN."""
    t = np.concatenate([tree.threshold, tree.feature_low, tree.feature_high])
    t = np.concatenate(
        [t, np.nextafter(t, np.float32(-np.inf)), np.nextafter(t, np.float32(np.inf)), SPECIAL]
    )
    t = np.concatenate([t, np.float32([-np.inf, np.inf, np.nan])])
    x = rng.choice(t, (n, tree.n_features))
    anywhere = rng.random(x.shape) < 0.3
    return np.where(anywhere, rng.normal(size=x.shape), x).astype(np.float32)


def within_bounds(tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    """Keep the observations that the space has."""
    return x[((x >= tree.feature_low) & (x <= tree.feature_high)).all(axis=1)]


def every_cell(tree: DecisionTree, *, nan: bool) -> np.ndarray:
    """Return one observation in each cell of the grid of all thresholds, and on all of the cell's corners."""
    axes = []
    for feature in range(tree.n_features):
        if feature in tree.group_of:
            axes.append(np.float32([0, 1]))
            continue
        t = np.unique(tree.threshold[tree.feature == feature])
        above = np.where(t == 0, np.finfo(np.float32).smallest_normal, np.nextafter(t, np.float32(np.inf)))
        ends = np.float32([-np.inf, np.inf] + [np.nan] * nan)
        axes.append(
            np.concatenate([t, above, tree.feature_low[[feature]], tree.feature_high[[feature]], ends])
        )
    return np.array(list(product(*map(np.unique, axes))), np.float32)


def consistent(tree: DecisionTree, x: np.ndarray) -> np.ndarray:
    """Keep the observations in which exactly one feature of each group is 1 and the others are 0."""
    for group in tree.groups:
        of_group = np.sort(x[:, group.features], axis=1)
        x = x[(of_group == np.eye(len(group.features))[-1]).all(axis=1)]
    return x


def plain_leaf(tree: DecisionTree, observation: np.ndarray, root: int = 0) -> int:
    """Descend in a loop that nobody can misread."""
    x = [float(np.float32(v)) for v in observation]
    x = [0.0 if abs(v) < 2.0**-126 else v for v in x]
    node = root
    while tree.children_left[node] != -1:
        left = x[tree.feature[node]] <= float(tree.threshold[node])
        node = int(tree.children_left[node] if left else tree.children_right[node])
    return node


def chain(depth: int, *, to_left: bool, actions: ActionSpec) -> DecisionTree:
    """Make a tree that is one long path."""
    n_nodes = 2 * depth + 1
    arrays: dict[str, Any] = {
        "children_left": np.full(n_nodes, -1),
        "children_right": np.full(n_nodes, -1),
        "feature": np.full(n_nodes, -2),
        "threshold": np.full(n_nodes, -2.0),
        "value": np.zeros((n_nodes, actions.n_outputs)),
    }
    inner = np.arange(depth) if to_left else np.arange(0, 2 * depth, 2)
    arrays["children_left"][inner] = inner + 1
    arrays["children_right"][inner] = n_nodes - 1 - inner if to_left else inner + 2
    arrays["feature"][inner] = 0
    steps = np.arange(depth, dtype=np.float64)
    arrays["threshold"][inner] = -steps if to_left else steps
    leaves = np.flatnonzero(arrays["children_left"] == -1)
    arrays["value"][leaves] = np.eye(actions.n_outputs)[np.arange(len(leaves)) % actions.n_outputs]
    return DecisionTree(
        **arrays,
        actions=actions,
        feature_names=("x",),
        feature_low=np.full(1, -np.inf),
        feature_high=np.full(1, np.inf),
    )
