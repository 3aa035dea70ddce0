"""Extract a `DecisionTree` from trained parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..functional.float32_order import unscale_thresholds
from ..trees import DecisionTree
from .tree import Tree


def extract_tree(actor: Tree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """The complete tree over raw observations that acts, on every float32 observation, as the actor does.

    The actor sees ``(x − shift) · scale``; the tree's thresholds undo the scaling exactly (`unscale_thresholds`).
    ``reading`` is as of `raw_tree`.
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
    """The complete tree over raw observations of splits over scaled ones; ``reading`` is what its readers are told."""
    raw = unscale_thresholds(threshold, np.asarray(shift)[feature], np.asarray(scale)[feature])
    return DecisionTree.from_complete(feature, raw, leaf_values, **metadata)
