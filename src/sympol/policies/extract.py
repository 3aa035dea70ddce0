"""Extract a `DecisionTree` from trained parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..functional.float32_order import unscale_thresholds
from ..trees import DecisionTree
from .tree import Tree


def extract_tree(actor: Tree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """Return the complete tree over raw observations that acts as an actor does, on every float32 observation.

    The actor sees ``(x − shift) · scale``; the tree's thresholds undo the scaling exactly (`unscale_thresholds`).

    Args:
        actor: The actor.
        shift: The shift of each feature.
        scale: The scale of each feature.
        metadata: The fields of the tree that describe its features and actions.

    Returns:
        The tree.
    """
    feature = np.argmax(np.asarray(actor.feature_logits), axis=1)
    threshold = np.take_along_axis(np.asarray(actor.thresholds), feature[:, None], axis=1)[:, 0]
    return raw_tree(feature, threshold, np.asarray(actor.leaf_values), shift, scale, **metadata)


def raw_tree(
    feature: np.ndarray,
    threshold: np.ndarray,
    leaf_values: np.ndarray,
    shift: np.ndarray,
    scale: np.ndarray,
    **metadata: Any,
) -> DecisionTree:
    """Return the complete tree over raw observations of splits over scaled ones.

    Args:
        feature: The feature of each split.
        threshold: The threshold of each split, for the scaled feature.
        leaf_values: The outputs of each leaf.
        shift: The shift of each feature.
        scale: The scale of each feature.
        metadata: The fields of the tree that describe its features and actions.

    Returns:
        The tree.
    """
    raw = unscale_thresholds(threshold, np.asarray(shift)[feature], np.asarray(scale)[feature])
    return DecisionTree.from_complete(feature, raw, leaf_values, **metadata)
