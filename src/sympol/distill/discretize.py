"""D-SDT: a soft decision tree made hard (Silva et al. 2020, arXiv:1903.09338)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..policies.extract import raw_tree
from ..policies.soft_tree import SoftTree
from ..trees import DecisionTree


def discretize(actor: SoftTree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """Return the complete hard tree that keeps the heaviest feature of each node and the likelier side of each gate.

    A gate is more than half open to the left where w · x < τ. With all weight on feature j that is x_j · w_j ≤ τ, and
    x_j ≤ τ / w_j, for the largest weight is never zero. Of equal weights the first feature's counts. The influence of
    the other features is lost, and so is the average of the leaves: a D-SDT may act quite unlike its soft tree.

    The soft tree sees ``(x − shift) · scale``; this tree's thresholds undo the scaling exactly.

    Args:
        actor: The soft tree.
        shift: The shift of each feature.
        scale: The scale of each feature.
        metadata: The fields of the tree that describe its features and actions.

    Returns:
        The tree.
    """
    weights = np.asarray(actor.weights)
    feature = np.argmax(weights, axis=1)
    threshold = np.asarray(actor.thresholds) / np.take_along_axis(weights, feature[:, None], axis=1)[:, 0]
    return raw_tree(feature, threshold, np.asarray(actor.leaf_values), shift, scale, **metadata)
