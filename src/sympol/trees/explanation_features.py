"""Features and groups as units of explanation, and the changes of an observation that lead to each leaf."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from .base import BaseTree
from .boxes import Boxes, leaf_boxes
from .floats import number, observation_batch, printable
from .groups import Group
from .name_lookup import position

if TYPE_CHECKING:
    from jaxtyping import Bool, Float32, Int
    from numpy.typing import ArrayLike


@final
@dataclass(frozen=True)
class Unit:
    """A single feature, or a group whose features change together."""

    name: str
    features: tuple[int, ...]
    group: Group | None = None

    def words(self, x: Float32[np.ndarray, " features"]) -> str:
        """Describe its value in an observation: ``pole angle = 0.1``, ``front is lava``."""
        if self.group is None:
            return f"{printable(self.name)} = {number(x[self.features[0]])}"
        return self.group.words(next(feature for feature in self.features if x[feature] == 1))

    def change(self, x: Float32[np.ndarray, " features"], y: Float32[np.ndarray, " features"]) -> str:
        """Describe a change from x to y: ``pole angle = 0.1 instead of 0``, ``front is lava instead of wall``."""
        if self.group is None:
            return f"{self.words(y)} instead of {number(x[self.features[0]])}"
        was = next(i for i, feature in enumerate(self.features) if x[feature] == 1)
        return f"{self.words(y)} instead of {printable(self.group.categories[was])}"


@final
@dataclass(frozen=True, eq=False)
class LocalNeighborhood:
    """An observation and, for each leaf, the features that must change to reach it.

    A unit can keep its value, even one outside the space, or take a value of the space: within the bounds, one-hot,
    whole where it is a whole number.
    """

    x: Float32[np.ndarray, " features"]
    """The observation as the tree sees it, flushed float32."""
    leaf: int
    """The leaf it reaches."""
    units: tuple[Unit, ...]
    leaves: Int[np.ndarray, " leaves"]
    keeps: Bool[np.ndarray, "leaves units"]
    """Whether each unit can keep its value on the path to each leaf."""
    can: Bool[np.ndarray, "leaves units"]
    """Whether some value of the space for each unit leads to each leaf."""
    possible: Boxes
    """The observations of the space that reach each leaf."""

    @property
    def reachable(self) -> Bool[np.ndarray, " leaves"]:
        """Whether some change reaches each leaf, [leaves]."""
        return np.all(self.keeps | self.can, axis=1)


def local_neighborhood(tree: BaseTree, observation: ArrayLike) -> LocalNeighborhood:
    """Compare an observation with every leaf of a tree.

    Args:
        tree: The policy.
        observation: One observation, [features]; finite.

    Returns:
        For each leaf, which units can stay and which can change.

    Raises:
        ValueError: If it has another shape, is not one-hot where it must be, or is not finite.
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
    units = units_of(tree)
    return LocalNeighborhood(
        x,
        leaf,
        units,
        np.flatnonzero(tree.is_leaf),
        _by_unit(units, (asked.low <= x) & (x <= asked.high)),
        _by_unit(units, possible.low <= possible.high),
        possible,
    )


def units_of(tree: BaseTree) -> tuple[Unit, ...]:
    """Return the features and groups of a tree as units, in the order of their first features."""
    single = (Unit(name, (i,)) for i, name in enumerate(tree.feature_names) if i not in tree.group_of)
    grouped = (Unit(group.name or "/".join(group.categories), group.features, group) for group in tree.groups)
    return tuple(sorted((*single, *grouped), key=lambda unit: min(unit.features)))


def positions(tree: BaseTree, units: tuple[Unit, ...], named: Iterable[str | int]) -> set[int]:
    """Return the units with these names of features or groups, or positions of features.

    Raises:
        ValueError: If there is no such feature or group, or several have the name.
    """
    of_feature = {feature: i for i, unit in enumerate(units) for feature in unit.features}
    names = [*tree.feature_names, *(unit.name for unit in units if unit.group is not None)]
    members = [*range(tree.n_features), *(unit.features[0] for unit in units if unit.group is not None)]
    found = set()
    for name in named:
        feature = members[position(name, names, "feature")] if isinstance(name, str) else name
        if feature not in of_feature:
            raise ValueError(f"a feature must be from 0 to {tree.n_features - 1}, got {name!r}")
        found.add(of_feature[feature])
    return found


def _by_unit(units: tuple[Unit, ...], of_features: np.ndarray) -> Bool[np.ndarray, "leaves units"]:
    return np.stack([of_features[:, list(unit.features)].all(axis=1) for unit in units], axis=1)
