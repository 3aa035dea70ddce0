"""How far observations are from another action: exact distances to the boxes of the leaves that act otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, leaf_boxes
from ..floats import observation_batch
from ..name_lookup import feature_position
from .arrivals import numbers
from .names import without_units

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32
    from numpy.typing import ArrayLike

Categories: TypeAlias = Literal["fixed", "free"]
_AT_ONCE = 1_000_000
"""Distances that are computed at the same time."""


class Margins(NamedTuple):
    """How far each observation is from another action."""

    radius: Float[np.ndarray, " batch"]
    """In units of the scale; whatever is nearer gets the same action. Infinite where everything does."""
    nearest: Float32[np.ndarray, "batch features"]
    """An observation as far as that which gets another action; NaN throughout where there is none."""


class Noise(NamedTuple):
    """What noise of a given size can do."""

    can_change: Bool[np.ndarray, " batch"]
    """Whether some noise up to this size changes the action in each observation."""
    by_feature: Mapping[str, float]
    """The share of the observations in which noise in this feature alone can, the largest first."""

    @property
    def share(self) -> float:
        """The share of the observations in which some noise can."""
        return float(self.can_change.mean())


def margin(
    tree: BaseTree,
    observations: ArrayLike,
    scale: ArrayLike = 1.0,
    *,
    categories: Categories = "fixed",
    within_bounds: bool = True,
) -> Margins:
    """Return the largest box around each observation in which the action stays.

    The box reaches from ``x - radius * scale`` to ``x + radius * scale``, its ends not included, and holds float32
    observations. Distances are computed in float64, from boxes that are exact.

    Args:
        tree: The policy.
        observations: [batch, features], or one.
        scale: The unit of each feature, [features] or one for all; 0 for one that cannot change.
        categories: Whether the categories of groups stay as they are, or can be any at no distance.
        within_bounds: Whether only observations within the bounds of the space count.

    Raises:
        ValueError, TypeError: if these are no observations of the tree's, or the scale is negative or NaN.
    """
    x, _ = observation_batch(observations, tree.n_features)
    unit = _checked_scale(tree, scale)
    boxes = leaf_boxes(tree, bounds=within_bounds)
    reached = ~boxes.is_empty
    boxes, leaves = boxes[reached], np.flatnonzero(tree.is_leaf)[reached]
    _, kind = np.unique(numbers(tree, np.arange(tree.n_nodes)), axis=0, return_inverse=True)
    of_box, of_x = kind[leaves], kind[tree.apply(x)]
    radius = np.full(len(x), np.inf)
    nearest = np.full(x.shape, np.nan, np.float32)
    for one in np.unique(of_x):
        others = boxes[of_box != one]
        if len(others):
            rows = np.flatnonzero(of_x == one)
            for some in np.array_split(rows, len(rows) * len(others) // _AT_ONCE + 1):
                away = _distances(x[some], others, unit, categories)
                box = away.argmin(axis=1)
                radius[some] = away[np.arange(len(some)), box]
                nearest[some] = _moved(x[some], others[box])
    nearest[np.isinf(radius)] = np.nan
    return Margins(radius, nearest)


def noise(
    tree: BaseTree,
    observations: ArrayLike,
    size: ArrayLike | Mapping[str, float],
    *,
    within_bounds: bool = True,
) -> Noise:
    """Return in which observations noise can change the action, and through which feature alone.

    Args:
        tree: The policy.
        observations: [batch, features], or one.
        size: The greatest error of each feature, [features] or one for all, or by name, others without any; it is
            an error of the float32 observation. Categories of groups are not mistaken.
        within_bounds: Whether only observations within the bounds of the space are mistaken for it.

    Raises:
        ValueError, TypeError: as `margin` does, or a name is unknown.
    """
    if isinstance(size, Mapping):
        sizes, short = np.zeros(tree.n_features), without_units(tree.feature_names)
        for name, most in size.items():
            sizes[feature_position(tree, short.get(name, name))] = most
    else:
        sizes = _checked_scale(tree, size)

    def can_change(greatest: np.ndarray) -> np.ndarray:
        return margin(tree, observations, greatest, within_bounds=within_bounds).radius <= 1

    shares: dict[str, float] = {}
    for feature in np.unique(tree.feature[~tree.is_leaf]).tolist():
        if sizes[feature] > 0 and feature not in tree.group_of:
            alone = np.where(np.arange(tree.n_features) == feature, sizes, 0)
            shares[tree.feature_names[feature]] = float(can_change(alone).mean())
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return Noise(can_change(sizes), dict(ordered))


def _checked_scale(tree: BaseTree, scale: ArrayLike) -> Float[np.ndarray, " features"]:
    unit = np.asarray(scale, np.float64)
    if unit.shape not in ((), (tree.n_features,)):
        raise ValueError(
            f"expected one number or {tree.n_features}, one a feature, got shape {list(unit.shape)}"
        )
    if not (unit >= 0).all():
        raise ValueError(
            f"a scale must be 0 or more, got {unit.min() if unit.size else unit}; use 0 for what stays"
        )
    return np.broadcast_to(unit, (tree.n_features,))


def _distances(
    x: Float32[np.ndarray, "batch features"], boxes: Boxes, unit: np.ndarray, categories: Categories
) -> Float[np.ndarray, "batch boxes"]:
    """The distance of each observation from each box: that of its farthest feature, in its unit."""
    away = np.zeros((len(x), len(boxes)))
    grouped = {feature for group in boxes.groups for feature in group.features}
    for feature in range(x.shape[1]):
        at = x[:, feature, None].astype(np.float64)
        low, high = boxes.low[:, feature].astype(np.float64), boxes.high[:, feature].astype(np.float64)
        if feature in grouped:
            if categories == "fixed":
                away[(at == 1) & (high < 1)] = np.inf
            continue
        with np.errstate(invalid="ignore", divide="ignore"):  # of the branches that are not taken
            distance = np.where(at < low, low - at, np.where(at > high, at - high, 0.0))
            distance[np.isnan(at) & ~boxes.nan[:, feature]] = np.inf
            np.maximum(away, np.where(distance > 0, distance / unit[feature], 0.0), out=away)
    return away


def _moved(x: Float32[np.ndarray, "batch features"], boxes: Boxes) -> Float32[np.ndarray, "batch features"]:
    """Each observation moved into its box, no farther than it must."""
    moved = np.clip(x, boxes.low, boxes.high)
    for group in boxes.groups:
        features = list(group.features)
        stays = (moved[:, features].sum(axis=1) == 1) & (x[:, features] == moved[:, features]).all(axis=1)
        first = np.eye(len(features), dtype=np.float32)[boxes.high[:, features].argmax(axis=1)]
        moved[:, features] = np.where(stays[:, None], x[:, features], first)
    return moved
