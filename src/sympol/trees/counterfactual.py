"""Counterfactuals: the nearest observation for which the tree takes another action.

The observations that reach a leaf are a box, whose nearest point is found feature by feature: the nearer end of
the interval. So the nearest observation of all is found exactly, leaf by leaf.

The distance of two observations: the difference of each feature, or 1 for a group whose category changes, divided
by its scale (1 by default), summed (``l1``) or at its maximum (``linf``); ``l0`` counts the changes. Of equally near
observations the one with fewer changes wins, then the one with the smaller sum.

What changes stays in the space: within the bounds, whole numbers whole, one category of each group. What does not
change stays as it is, even where that was out of bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, final

import numpy as np

from .actions import DiscreteActions
from .base import BaseTree
from .explanation_features import LocalNeighborhood, local_neighborhood, positions

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32
    from numpy.typing import ArrayLike

Norm: TypeAlias = Literal["l1", "l0", "linf"]
NORMS: tuple[Norm, ...] = ("l1", "l0", "linf")


@final
@dataclass(frozen=True, eq=False)
class Counterfactual:
    """Another action and the nearest observation that gets it."""

    action: np.ndarray
    answer: str
    """The action in words."""
    observation: Float32[np.ndarray, " features"] | None
    """None where no observation that may be reached gets it."""
    distance: float
    """Infinite where there is none."""
    changes: tuple[str, ...]
    """``pole angle = 0.1 instead of 0``."""

    @property
    def words(self) -> str:
        """The counterfactual as a sentence."""
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
    """Return the nearest observation with a wanted action, the given one included; None if there is none.

    For continuous actions: ``nearest(tree, x, lambda torque: torque >= 1)``.

    Args:
        tree: The policy.
        observation: One observation, [features]; finite.
        wanted: A function that returns whether an action, as `DecisionTree.predict` returns it, is wanted.
        immutable: Features and groups that must stay as they are, by name or position.
        norm: How distances are measured.
        scale: What counts as a change by 1, for features and groups, by name or position.

    Returns:
        The counterfactual, or None if no observation gets a wanted action.

    Raises:
        ValueError: As `explain` does.
        TypeError: As `explain` does.
    """
    here = local_neighborhood(tree, observation)
    actions = tree.leaf_actions[here.leaves]
    mask = np.array([bool(wanted(action)) for action in actions])
    found = _nearest(Costs.of(tree, here, immutable, norm, scale), mask)
    if found is None:
        return None
    row, distance = found
    return _counterfactual(tree, here, actions[row], row, distance)


def counterfactuals(
    tree: BaseTree,
    here: LocalNeighborhood,
    *,
    immutable: Iterable[str | int] = (),
    norm: Norm = "l1",
    scale: Mapping[str | int, float] | None = None,
) -> tuple[Counterfactual, ...]:
    """Return the nearest observation of every other action, the nearest first and those without one last.

    A discrete space has all its actions examined, other spaces those that some leaf takes.
    """
    costs = Costs.of(tree, here, immutable, norm, scale)
    actions = tree.leaf_actions[here.leaves]
    own = actions[np.searchsorted(here.leaves, here.leaf)]
    space = tree.actions
    every = np.arange(space.n) + space.start if isinstance(space, DiscreteActions) else actions
    # + 0 makes -0.0 to 0.0, which is the same action
    others = {(action + 0).tobytes(): np.asarray(action) for action in every if (action != own).any()}
    found = []
    for action in others.values():
        mask = (actions == action).reshape(len(actions), -1).all(axis=1)
        row, distance = _nearest(costs, mask) or (None, math.inf)
        found.append(_counterfactual(tree, here, action, row, distance))
    return tuple(sorted(found, key=lambda one: one.distance))


@final
@dataclass(frozen=True, eq=False)
class Costs:
    """The distance of each leaf, and what decides between equal ones: changes, then their sum."""

    distance: Float[np.ndarray, " leaves"]
    changes: Float[np.ndarray, " leaves"]
    total: Float[np.ndarray, " leaves"]

    @classmethod
    def of(
        cls,
        tree: BaseTree,
        here: LocalNeighborhood,
        immutable: Iterable[str | int],
        norm: Norm,
        scale: Mapping[str | int, float] | None,
    ) -> Costs:
        """Measure. Raises ValueError for features that there are not, scales that are none, or another norm."""
        if norm not in NORMS:
            raise ValueError(f"norm must be one of {', '.join(NORMS)}, got {norm!r}")
        units = here.units
        fixed = positions(tree, units, immutable)
        scales = np.ones(len(units))
        for name, value in (scale or {}).items():
            if isinstance(value, bool | str) or not 0 < value < math.inf:
                raise ValueError(f"the scale of {name!r} must be positive and finite, got {value!r}")
            scales[[*positions(tree, units, [name])]] = value
        away = np.array([_away(here, row) for row in range(len(here.leaves))]) / scales
        away[:, [*fixed]] = np.inf
        away = np.where(here.keeps, 0, np.where(here.can, away, np.inf))
        total, changes = away.sum(axis=1), np.count_nonzero(~here.keeps, axis=1).astype(float)
        measured = {
            "l1": total,
            "l0": np.where(np.isfinite(total), changes, np.inf),
            "linf": away.max(axis=1),
        }
        return cls(measured[norm], changes, total)


def _away(here: LocalNeighborhood, row: int) -> Float[np.ndarray, " units"]:
    """How far each unit's nearest value in a leaf is."""
    y = _projected(here, row).astype(np.float64)
    return np.array(
        [
            1.0 if unit.group else abs(y[unit.features[0]] - float(here.x[unit.features[0]]))
            for unit in here.units
        ]
    )


def _projected(here: LocalNeighborhood, row: int) -> Float32[np.ndarray, " features"]:
    """The nearest observation of those that end in a leaf; of categories, the first."""
    low, high, y = here.possible.low[row], here.possible.high[row], here.x.copy()
    for i, unit in enumerate(here.units):
        features = list(unit.features)
        if here.keeps[row, i]:
            continue
        if unit.group is None:
            y[features] = np.minimum(np.maximum(y[features], low[features]), high[features])
        else:
            y[features] = 0
            y[features[int(np.argmax(high[features]))]] = 1
    return y


def _nearest(costs: Costs, mask: Bool[np.ndarray, " leaves"]) -> tuple[int, float] | None:
    rows = np.flatnonzero(mask & np.isfinite(costs.distance))
    if not len(rows):
        return None
    row = rows[np.lexsort((costs.total[rows], costs.changes[rows], costs.distance[rows]))[0]]
    return int(row), float(costs.distance[row])


def _counterfactual(
    tree: BaseTree, here: LocalNeighborhood, action: np.ndarray, row: int | None, distance: float
) -> Counterfactual:
    answer = ", ".join(tree.actions.words(action))
    if row is None:
        return Counterfactual(action, answer, None, math.inf, ())
    y = _projected(here, row)
    y.setflags(write=False)
    changed = [unit for i, unit in enumerate(here.units) if not here.keeps[row, i]]
    return Counterfactual(action, answer, y, distance, tuple(unit.change(here.x, y) for unit in changed))
