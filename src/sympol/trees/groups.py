"""Groups of features that are one-hot together: exactly one of each group is 1 and the others are 0.

Examples are a ``Discrete`` observation or the object in one cell of a grid. A group says more than bounds do: a
split that another category has decided is pruned (`sympol.trees.prune`), and a question reads "front is lava".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from .floats import printable

if TYPE_CHECKING:
    from jaxtyping import Float32

LARGEST_CELL = 999
"""The last row and column of a view: a view is drawn whole, so a tree from a stranger must not make it large."""


@final
@dataclass(frozen=True)
class Group:
    """A choice among categories, encoded by one feature for each.

    Args:
        name: The name of the choice, such as ``"front"``; empty where the categories say enough.
        features: The position in an observation of the feature of each category.
        categories: What each feature means when it is 1, such as ``"lava"``.
        cell: The row and column, from the upper left, of the cell of the agent's square view that this describes.
            The agent stands in the middle of the lowest row and looks up. None for what has no place in a view.

    Raises:
        ValueError: If there are no features, one occurs twice, or there are not as many categories.
    """

    name: str
    features: tuple[int, ...]
    categories: tuple[str, ...]
    cell: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Make tuples and check."""
        features, categories = tuple(int(f) for f in self.features), tuple(self.categories)
        object.__setattr__(self, "features", features)
        object.__setattr__(self, "categories", categories)
        if self.cell is not None:
            row, column = self.cell
            object.__setattr__(self, "cell", (int(row), int(column)))
            if not (0 <= row <= LARGEST_CELL and 0 <= column <= LARGEST_CELL):
                raise ValueError(
                    f"the cell of group {self.name!r} must be a row and a column from 0 to {LARGEST_CELL}, "
                    f"got {self.cell}"
                )
        if not features or min(features) < 0 or len(set(features)) < len(features):
            raise ValueError(
                f"the features of group {self.name!r} must be different positions, got {features}"
            )
        if len(categories) != len(features) or not all(isinstance(c, str) for c in (self.name, *categories)):
            raise ValueError(
                f"group {self.name!r} must have a category, a string, for each of its {len(features)} features, "
                f"got {categories!r}"
            )

    def words(self, feature: int, *, negated: bool = False) -> str:
        """Describe that a feature of this group is 1, or (``negated``) that it is 0: ``front is lava``.

        Args:
            feature: Position of a feature of this group.
            negated: Whether the feature is 0 instead of 1.

        Returns:
            The condition in words.
        """
        category = printable(self.categories[self.features.index(feature)])
        if not self.name:
            return f"not {category}" if negated else category
        return f"{printable(self.name)} is {'not ' if negated else ''}{category}"

    def words_without(self, features: Sequence[int]) -> str:
        """Describe that none of these features is 1: ``front is neither lava nor wall``.

        Args:
            features: Positions of features of this group.

        Returns:
            The condition in words.
        """
        if len(features) == 1:
            return self.words(features[0], negated=True)
        *some, last = (printable(self.categories[self.features.index(feature)]) for feature in features)
        neither = f"neither {', '.join(some)} nor {last}"
        return f"{printable(self.name)} is {neither}" if self.name else neither


def check_groups(groups: Sequence[Group], n_features: int) -> tuple[Group, ...]:
    """Return the groups. Raises ValueError where a feature does not exist or is in two groups."""
    owner: dict[int, str] = {}
    for group in groups:
        for feature in group.features:
            if feature >= n_features:
                raise ValueError(
                    f"group {group.name!r} has feature {feature}, but there are {n_features} features"
                )
            if feature in owner:
                raise ValueError(f"feature {feature} is in two groups, {owner[feature]!r} and {group.name!r}")
            owner[feature] = group.name
    return tuple(groups)


def check_integers(integers: Sequence[int], groups: Sequence[Group], n_features: int) -> tuple[int, ...]:
    """Return sorted positions of integer features. Raises ValueError where one does not exist or is in a group."""
    ordered = tuple(sorted({int(i) for i in integers}))
    grouped = {feature for group in groups for feature in group.features}
    for i in ordered:
        if not 0 <= i < n_features:
            raise ValueError(f"integers must be positions of the {n_features} features, got {i}")
        if i in grouped:
            raise ValueError(f"feature {i} is in a group, which says more than that it is a whole number")
    return ordered


def require_one_hot(groups: Sequence[Group], x: Float32[np.ndarray, "batch features"]) -> None:
    """Raise ValueError, naming the observation, unless exactly one feature of each group is 1 and the others are 0."""
    if not groups:
        return
    order = np.concatenate([group.features for group in groups])
    starts = np.cumsum([0, *(len(group.features) for group in groups[:-1])])
    chosen = x[:, order]
    wrong = np.add.reduceat(chosen, starts, axis=1) != 1
    wrong |= np.logical_or.reduceat((chosen != 0) & (chosen != 1), starts, axis=1)
    if wrong.any():
        row, which = np.argwhere(wrong)[0]
        group = groups[which]
        raise ValueError(
            f"group {group.name!r} must be a single 1 and otherwise 0, got {x[row, list(group.features)].tolist()} "
            f"for {list(group.categories)} in observation {x[row].tolist()}; correct the environment, or leave the "
            "group out"
        )
