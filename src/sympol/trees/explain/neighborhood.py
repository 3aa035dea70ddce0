"""The neighbourhood of an observation: what can change in it, and which changes lead to which leaf."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, leaf_boxes
from ..floats import number, observation_batch, printable
from ..groups import Group
from ..name_lookup import position

if TYPE_CHECKING:
    from jaxtyping import Bool, Float32, Int, Shaped
    from numpy.typing import ArrayLike


@final
@dataclass(frozen=True)
class ExplanationFeature:
    """A unit of change in explanations: a feature, or a group, whose features change together.

    Args:
        name: The name of the feature or group; the categories if the group has no name.
        positions: The positions of its features in an observation.
        group: The group; None for a single feature.
    """

    name: str
    positions: tuple[int, ...]
    group: Group | None = None

    def words(self, x: Float32[np.ndarray, " features"]) -> str:
        """Describe its value in an observation: ``pole angle = 0.1``, ``front is lava``."""
        if self.group is None:
            return f"{printable(self.name)} = {number(x[self.positions[0]])}"
        return self.group.words(next(feature for feature in self.positions if x[feature] == 1))

    def change(self, x: Float32[np.ndarray, " features"], y: Float32[np.ndarray, " features"]) -> str:
        """Describe its change from x to y: ``pole angle = 0.1 instead of 0``, ``front is lava instead of wall``."""
        if self.group is None:
            return f"{self.words(y)} instead of {number(x[self.positions[0]])}"
        was = next(i for i, feature in enumerate(self.positions) if x[feature] == 1)
        return f"{self.words(y)} instead of {printable(self.group.categories[was])}"


@final
@dataclass(frozen=True, eq=False)
class LocalNeighborhood:
    """An observation and, for each leaf, the features that must change to reach it.

    A feature can stay as it is, or take a value of the space: within the bounds, one-hot, whole if it is a whole
    number. Its own value is possible even if the space does not have it.

    Args:
        x: The observation, as the tree sees it.
        leaf: The leaf in which it ends.
        features: What can change in it.
        leaves: All leaves of the tree.
        actions: The action of each leaf.
        keeps: Whether each feature can stay as it is in an observation that ends in each leaf.
        can_change: Whether a value of the space of each feature leads to each leaf.
        possible: The observations of the space that end in each leaf.
    """

    x: Float32[np.ndarray, " features"]
    leaf: int
    features: tuple[ExplanationFeature, ...]
    leaves: Int[np.ndarray, " leaves"]
    actions: Shaped[np.ndarray, "leaves ..."]
    keeps: Bool[np.ndarray, "leaves explained"]
    can_change: Bool[np.ndarray, "leaves explained"]
    possible: Boxes

    @property
    def own(self) -> int:
        """The row of the leaf in which the observation ends, among ``leaves``."""
        return int(np.searchsorted(self.leaves, self.leaf))

    @property
    def reachable(self) -> Bool[np.ndarray, " leaves"]:
        """True for each leaf that can be reached if everything may change."""
        return np.all(self.keeps | self.can_change, axis=1)


def neighborhood_of(tree: BaseTree, observation: ArrayLike) -> LocalNeighborhood:
    """Return the neighbourhood of an observation.

    Args:
        tree: The tree.
        observation: The observation [features]; finite.

    Raises:
        ValueError: If it has another shape, is not one-hot in a group, or is not finite.
        TypeError: If it does not hold numbers.
    """
    batch, single = observation_batch(observation, tree.n_features)
    if not single:
        raise ValueError(f"expected one observation [{tree.n_features}], got {len(batch)}")
    leaf, x = int(np.atleast_1d(tree.apply(batch))[0]), batch[0]
    if not np.isfinite(x).all():
        wrong = int(np.argmin(np.isfinite(x)))
        raise ValueError(
            f"an observation to explain must be finite, got {x[wrong]} for {tree.feature_names[wrong]!r}"
        )
    asked = leaf_boxes(replace(tree, integers=()), bounds=False)
    possible = leaf_boxes(tree, bounds=True)
    features, leaves = explanation_features(tree), np.flatnonzero(tree.is_leaf)
    return LocalNeighborhood(
        x,
        leaf,
        features,
        leaves,
        tree.leaf_actions[leaves],
        _combined(features, (asked.low <= x) & (x <= asked.high)),
        _combined(features, possible.low <= possible.high),
        possible,
    )


def explanation_features(tree: BaseTree) -> tuple[ExplanationFeature, ...]:
    """Return the groups of a tree and its other features, in the order of their first positions."""
    single = [
        ExplanationFeature(name, (i,)) for i, name in enumerate(tree.feature_names) if i not in tree.group_of
    ]
    grouped = [
        ExplanationFeature(group.name or "/".join(group.categories), group.features, group)
        for group in tree.groups
    ]
    return tuple(sorted((*single, *grouped), key=lambda feature: min(feature.positions)))


def feature_indices(
    tree: BaseTree, features: Sequence[ExplanationFeature], named: Iterable[str | int]
) -> set[int]:
    """Return which of the features are meant by names of features and groups, or by positions in an observation.

    Args:
        tree: The tree.
        features: Its `explanation_features`.
        named: Names or positions.

    Raises:
        ValueError: If there is no such feature or group, or several have the name.
    """
    index_of = {position: i for i, feature in enumerate(features) for position in feature.positions}
    groups = [feature for feature in features if feature.group is not None]
    names = [*tree.feature_names, *(group.name for group in groups)]
    members = [*range(tree.n_features), *(group.positions[0] for group in groups)]
    found = set()
    for name in named:
        where = members[position(name, names, "feature")] if isinstance(name, str) else name
        if where not in index_of:
            raise ValueError(f"a feature must be from 0 to {tree.n_features - 1}, got {name!r}")
        found.add(index_of[where])
    return found


def _combined(
    features: Sequence[ExplanationFeature], each: Bool[np.ndarray, "leaves features"]
) -> Bool[np.ndarray, "leaves explained"]:
    return np.stack([each[:, list(feature.positions)].all(axis=1) for feature in features], axis=1)
