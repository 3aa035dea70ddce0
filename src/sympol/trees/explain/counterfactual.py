"""Counterfactuals: the nearest observation with another action.

All observations that end in a leaf are a box, and the nearest point of a box is the nearest of its interval, feature
by feature. So the nearest of all is found exactly, leaf by leaf.

A feature that changes is as far away as its difference divided by its scale (1 by default), a group that changes
its category as 1 divided by its scale. The distance is the sum of these (``l1``), the largest (``linf``), or the number
of changes (``l0``). Of several nearest observations the one with fewer changes wins, then the one with the smaller sum.

A change stays in the space: within the bounds, whole numbers whole, one category of each group. What does not change
may be out of bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, final

import numpy as np

from ..actions import DiscreteActions
from ..base import BaseTree
from .neighborhood import LocalNeighborhood, feature_indices, neighborhood_of

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32
    from numpy.typing import ArrayLike

Norm: TypeAlias = Literal["l1", "l0", "linf"]
NORMS: tuple[Norm, ...] = ("l1", "l0", "linf")


@final
@dataclass(frozen=True, eq=False)
class Counterfactual:
    """An action and the nearest observation that gets it.

    Args:
        action: The action, as `DecisionTree.predict` returns it.
        answer: The action in words.
        observation: The observation; None if none that may be reached gets the action.
        distance: Its distance; infinite if there is none.
        changes: The changes in words, such as ``pole angle = 0.1 instead of 0``.
    """

    action: np.ndarray
    answer: str
    observation: Float32[np.ndarray, " features"] | None
    distance: float
    changes: tuple[str, ...]

    @property
    def words(self) -> str:
        """The counterfactual in one sentence."""
        if self.observation is None:
            return f"{self.answer}: not by any change"
        return f"{self.answer}, if {' and '.join(self.changes)}"


def nearest(
    tree: BaseTree,
    observation: ArrayLike,
    wanted: Callable[[np.ndarray], Any],
    *,
    immutable: Iterable[str | int] = (),
    norm: Norm = "l1",
    scale: Mapping[str | int, float] | None = None,
) -> Counterfactual | None:
    """Return the nearest observation whose action is wanted, the given one included.

    A range of continuous actions is given as ``nearest(tree, x, lambda torque: torque >= 1)``.

    Args:
        tree: The policy.
        observation: The observation [features]; finite.
        wanted: A function that tells whether an action, as `DecisionTree.predict` returns it, is wanted.
        immutable: Features and groups that must not change, by name or position.
        norm: The measure of distance: ``"l1"``, ``"l0"`` or ``"linf"``.
        scale: The change that counts as 1 for features and groups, by name or position; 1 by default.

    Returns:
        The counterfactual; None if no observation that may be reached gets a wanted action.

    Raises:
        ValueError: As `sympol.trees.explain.explain` does.
        TypeError: If the observation does not hold numbers.
    """
    near = neighborhood_of(tree, observation)
    mask = np.array([bool(wanted(action)) for action in near.actions])
    found = _nearest(_Distances.of(tree, near, immutable, norm, scale), mask)
    if found is None:
        return None
    row, distance = found
    return _counterfactual(tree, near, near.actions[row], row, distance)


def counterfactuals(
    tree: BaseTree,
    near: LocalNeighborhood,
    *,
    immutable: Iterable[str | int] = (),
    norm: Norm = "l1",
    scale: Mapping[str | int, float] | None = None,
) -> tuple[Counterfactual, ...]:
    """Return the nearest observation of every other action, the nearest first, those without one last.

    The actions are all of a discrete space, otherwise those of the leaves.

    Args:
        tree: The policy.
        near: The neighbourhood of the observation.
        immutable: Features and groups that must not change, by name or position.
        norm: The measure of distance.
        scale: The change that counts as 1, by name or position.

    Raises:
        ValueError: If a feature, a scale or the norm is invalid.
    """
    distances = _Distances.of(tree, near, immutable, norm, scale)
    actions, own = near.actions, near.actions[near.own]
    space = tree.actions
    every = np.arange(space.n) + space.start if isinstance(space, DiscreteActions) else actions
    # + 0 makes -0.0 to 0.0, which is the same action
    others = {(action + 0).tobytes(): np.asarray(action) for action in every if (action != own).any()}
    found = []
    for action in others.values():
        mask = (actions == action).reshape(len(actions), -1).all(axis=1)
        row, distance = _nearest(distances, mask) or (None, math.inf)
        found.append(_counterfactual(tree, near, action, row, distance))
    return tuple(sorted(found, key=lambda one: one.distance))


@final
@dataclass(frozen=True, eq=False)
class _Distances:
    """The distance of each leaf, and what decides between equal ones, in this order."""

    distance: Float[np.ndarray, " leaves"]
    changes: Float[np.ndarray, " leaves"]
    total: Float[np.ndarray, " leaves"]

    @classmethod
    def of(
        cls,
        tree: BaseTree,
        near: LocalNeighborhood,
        immutable: Iterable[str | int],
        norm: Norm,
        scale: Mapping[str | int, float] | None,
    ) -> _Distances:
        """Measure the distances; raise ValueError if a feature, a scale or the norm is invalid."""
        if norm not in NORMS:
            raise ValueError(f"norm must be one of {', '.join(NORMS)}, got {norm!r}")
        features = near.features
        fixed = feature_indices(tree, features, immutable)
        scales = np.ones(len(features))
        for name, value in (scale or {}).items():
            if isinstance(value, bool | str) or not 0 < value < math.inf:
                raise ValueError(f"the scale of {name!r} must be positive and finite, got {value!r}")
            scales[[*feature_indices(tree, features, [name])]] = value
        away = np.array([_away(near, row) for row in range(len(near.leaves))]) / scales
        away[:, [*fixed]] = np.inf
        away = np.where(near.keeps, 0, np.where(near.can_change, away, np.inf))
        total, changes = away.sum(axis=1), np.count_nonzero(~near.keeps, axis=1).astype(float)
        measured = {
            "l1": total,
            "l0": np.where(np.isfinite(total), changes, np.inf),
            "linf": away.max(axis=1),
        }
        return cls(measured[norm], changes, total)


def _away(near: LocalNeighborhood, row: int) -> Float[np.ndarray, " explained"]:
    """Return how far the nearest value of each feature in a leaf is."""
    y = _projected(near, row).astype(np.float64)
    return np.array(
        [
            1.0 if feature.group else abs(y[feature.positions[0]] - float(near.x[feature.positions[0]]))
            for feature in near.features
        ]
    )


def _projected(near: LocalNeighborhood, row: int) -> Float32[np.ndarray, " features"]:
    """Return the nearest observation that ends in a leaf; of several categories, the first."""
    low, high, y = near.possible.low[row], near.possible.high[row], near.x.copy()
    for i, feature in enumerate(near.features):
        positions = list(feature.positions)
        if near.keeps[row, i]:
            continue
        if feature.group is None:
            y[positions] = np.minimum(np.maximum(y[positions], low[positions]), high[positions])
        else:
            y[positions] = 0
            y[positions[int(np.argmax(high[positions]))]] = 1
    return y


def _nearest(distances: _Distances, mask: Bool[np.ndarray, " leaves"]) -> tuple[int, float] | None:
    rows = np.flatnonzero(mask & np.isfinite(distances.distance))
    if not len(rows):
        return None
    row = rows[np.lexsort((distances.total[rows], distances.changes[rows], distances.distance[rows]))[0]]
    return int(row), float(distances.distance[row])


def _counterfactual(
    tree: BaseTree, near: LocalNeighborhood, action: np.ndarray, row: int | None, distance: float
) -> Counterfactual:
    answer = ", ".join(tree.actions.words(action))
    if row is None:
        return Counterfactual(action, answer, None, math.inf, ())
    y = _projected(near, row)
    y.setflags(write=False)
    changed = [feature for i, feature in enumerate(near.features) if not near.keeps[row, i]]
    return Counterfactual(
        action, answer, y, distance, tuple(feature.change(near.x, y) for feature in changed)
    )
