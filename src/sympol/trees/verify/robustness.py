"""Robustness of single decisions: exact distances from observations to the leaves with another action."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from ..base import BaseTree
from ..boxes import Boxes, leaf_boxes
from ..floats import observation_batch
from ..name_lookup import feature_position
from .conditions import leaf_actions

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32
    from numpy.typing import ArrayLike

Categories: TypeAlias = Literal["fixed", "free"]
_DISTANCES_AT_ONCE = 1_000_000
"""Distances that are in memory at the same time."""


class Margins(NamedTuple):
    """The distance of each observation from another action."""

    radius: Float[np.ndarray, " batch"]
    """The distance in units of the scale: nearer observations get the same action. Infinite if there is no other."""
    nearest: Float32[np.ndarray, "batch features"]
    """An observation at that distance that gets another action; NaN throughout if there is none."""


class Noise(NamedTuple):
    """The effect that noise of a given size can have."""

    can_change: Bool[np.ndarray, " batch"]
    """Whether some noise up to this size changes the action in each observation."""
    by_feature: Mapping[str, float]
    """The share of the observations in which noise in this feature alone can do so, the largest first."""

    @property
    def share(self) -> float:
        """The share of the observations in which some noise can change the action."""
        return float(self.can_change.mean())


def margin(
    tree: BaseTree,
    observations: ArrayLike,
    scale: ArrayLike = 1.0,
    *,
    categories: Categories = "fixed",
    within_bounds: bool = True,
) -> Margins:
    """Return the largest box around each observation in which the action stays the same.

    The box reaches from ``x - radius * scale`` to ``x + radius * scale``, its ends not included, and holds float32
    observations. Distances are computed in float64, from boxes that are exact.

    Args:
        tree: The policy.
        observations: The observations [batch, features], or a single one [features].
        scale: The unit of each feature, [features] or one for all; 0 for a feature that cannot change.
        categories: ``"fixed"`` if the categories of groups stay as they are, ``"free"`` if they change at no cost.
        within_bounds: Whether only observations within the bounds of the space count.

    Returns:
        The radius of each box [batch], and an observation with another action at that distance [batch, features].

    Raises:
        ValueError: If the observations have another shape, or the scale is negative or NaN.
        TypeError: If the observations are not numbers.
    """
    x, _ = observation_batch(observations, tree.n_features)
    unit = _checked_scale(tree, scale)
    boxes = leaf_boxes(tree, bounds=within_bounds)
    reached = ~boxes.is_empty
    boxes, leaves = boxes[reached], np.flatnonzero(tree.is_leaf)[reached]
    _, action = np.unique(leaf_actions(tree, np.arange(tree.n_nodes)), axis=0, return_inverse=True)
    box_action, x_action = action[leaves], action[tree.apply(x)]
    radius = np.full(len(x), np.inf)
    nearest = np.full(x.shape, np.nan, np.float32)
    for one in np.unique(x_action):
        others = boxes[box_action != one]
        if len(others):
            rows = np.flatnonzero(x_action == one)
            for part in np.array_split(rows, len(rows) * len(others) // _DISTANCES_AT_ONCE + 1):
                distance = _distances(x[part], others, unit, categories)
                box = distance.argmin(axis=1)
                radius[part] = distance[np.arange(len(part)), box]
                nearest[part] = _moved(x[part], others[box])
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
        observations: The observations [batch, features], or a single one [features].
        size: The greatest error of each feature of the float32 observation: [features], one for all, or by name,
            where features without a name have no error. Categories of groups have none.
        within_bounds: Whether noise stays within the bounds of the space.

    Returns:
        Whether noise can change each action [batch], and the share of observations by feature.

    Raises:
        ValueError: As `margin` does, or if a name is unknown.
        TypeError: If the observations are not numbers.
    """
    if isinstance(size, Mapping):
        sizes = np.zeros(tree.n_features)
        for name, greatest in size.items():
            sizes[feature_position(tree, name)] = greatest
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
            f"a scale must be one number or {tree.n_features}, one a feature, got shape {list(unit.shape)}"
        )
    if not (unit >= 0).all():
        raise ValueError(
            f"a scale must be 0 or more, got {unit.min() if unit.size else unit}; use 0 for features that stay"
        )
    return np.broadcast_to(unit, (tree.n_features,))


def _distances(
    x: Float32[np.ndarray, "batch features"], boxes: Boxes, unit: np.ndarray, categories: Categories
) -> Float[np.ndarray, "batch boxes"]:
    """Return the distance of each observation from each box: that of its farthest feature, in its unit."""
    distance = np.zeros((len(x), len(boxes)))
    grouped = {feature for group in boxes.groups for feature in group.features}
    for feature in range(x.shape[1]):
        at = x[:, feature, None].astype(np.float64)
        low, high = boxes.low[:, feature].astype(np.float64), boxes.high[:, feature].astype(np.float64)
        if feature in grouped:
            if categories == "fixed":
                distance[(at == 1) & (high < 1)] = np.inf
            continue
        with np.errstate(invalid="ignore", divide="ignore"):  # in the branches that np.where does not take
            difference = np.where(at < low, low - at, np.where(at > high, at - high, 0.0))
            difference[np.isnan(at) & ~boxes.nan[:, feature]] = np.inf
            np.maximum(distance, np.where(difference > 0, difference / unit[feature], 0.0), out=distance)
    return distance


def _moved(x: Float32[np.ndarray, "batch features"], boxes: Boxes) -> Float32[np.ndarray, "batch features"]:
    """Move each observation into its box, no farther than necessary."""
    moved = np.clip(x, boxes.low, boxes.high)
    for group in boxes.groups:
        features = list(group.features)
        stays = (moved[:, features].sum(axis=1) == 1) & (x[:, features] == moved[:, features]).all(axis=1)
        first = np.eye(len(features), dtype=np.float32)[boxes.high[:, features].argmax(axis=1)]
        moved[:, features] = np.where(stays[:, None], x[:, features], first)
    return moved
