"""CART by scikit-learn, for environments."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32

from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from ..trees.actions import BoxActions

if TYPE_CHECKING:
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor


LITTLE = 2.0**-10
"""A feature that spreads by less is scaled for scikit-learn."""


def fit_cart(
    x: Float32[np.ndarray, "samples features"],
    actions: np.ndarray,
    spec: EnvSpec,
    *,
    depth: int | None,
    seed: int,
    max_nodes: int | None = None,
) -> DecisionTree:
    """Grow a tree by CART (Breiman et al. 1984) on observations and the actions to take in them.

    Discrete actions are classified by Gini impurity, several components at once; continuous ones are regressed by
    squared error. Which of equally good splits is taken depends on ``seed``, and on nothing else. Where the number of
    nodes is limited the tree grows where that gains most, and not level by level.

    Raises:
        ValueError: an observation that is not finite: CART cannot sort it.
    """
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

    finite = np.isfinite(x).all(axis=1)
    if not finite.all():
        raise ValueError(
            f"{spec.name} returned the observation {x[np.argmin(finite)].tolist()}, which is not finite; CART cannot "
            "sort it: correct the environment"
        )
    kind = DecisionTreeRegressor if isinstance(spec.actions, BoxActions) else DecisionTreeClassifier
    targets = actions if actions.ndim == 1 else actions.reshape(len(actions), -1)
    leaves = None if max_nodes is None else (max_nodes + 1) // 2
    unit = _units(x)
    estimator = kind(max_depth=depth, max_leaf_nodes=leaves, random_state=seed).fit(x / unit, targets)
    tree = from_sklearn(estimator, spec)
    # a threshold times a power of two is exact, or else becomes zero, and so does what it would be compared with
    in_units = np.where(tree.is_leaf, 1, unit[np.where(tree.is_leaf, 0, tree.feature)])
    return _within_seen_bounds(replace(tree, threshold=tree.threshold * in_units), spec, x)


def _units(x: Float32[np.ndarray, "samples features"]) -> Float32[np.ndarray, " features"]:
    """A power of two for each feature in which it spreads by about one: where it spreads by little, else 1.

    To scikit-learn, numbers less than 1e-7 apart are the same, whatever their unit.
    """
    spread = x.max(axis=0).astype(np.float64) - x.min(axis=0)
    little = (spread > 0) & (spread < LITTLE)
    return np.where(little, 2.0 ** np.floor(np.log2(np.where(little, spread, 1))), 1).astype(np.float32)


def from_sklearn(estimator: DecisionTreeClassifier | DecisionTreeRegressor, spec: EnvSpec) -> DecisionTree:
    """Convert a fitted tree of scikit-learn's for an environment; see `sympol.trees.from_sklearn`.

    Args:
        estimator: The fitted tree.
        spec: The environment.

    Returns:
        The tree.

    Raises:
        ValueError: Features, outputs or classes are not the environment's.
    """
    n_features = len(spec.features.names)
    if estimator.tree_.n_features != n_features:
        raise ValueError(
            f"a tree for {spec.name} must see {n_features} features, got one fitted on {estimator.tree_.n_features}"
        )
    return DecisionTree.from_sklearn(estimator, spec.actions, **spec.features.metadata())


def _within_seen_bounds(tree: DecisionTree, spec: EnvSpec, x: np.ndarray) -> DecisionTree:
    """The same tree without the bounds that the environment itself broke: pruning would believe them."""

    low, high = spec.features.low, spec.features.high
    return replace(
        tree,
        feature_low=np.where(x.min(axis=0) < low, -np.inf, low),
        feature_high=np.where(x.max(axis=0) > high, np.inf, high),
    )
