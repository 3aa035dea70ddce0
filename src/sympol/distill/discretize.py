"""D-SDT: a soft decision tree made hard (Silva et al. 2020, arXiv:1903.09338)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..policies.extract import raw_tree
from ..policies.soft_tree import SoftTree
from ..trees import DecisionTree


def discretize(actor: SoftTree, shift: np.ndarray, scale: np.ndarray, **metadata: Any) -> DecisionTree:
    """The complete hard tree that keeps of each node its heaviest feature, and of each gate its likelier way.

    A gate is more than half open to the left where w · x < τ. With all weight on feature j that is x_j · w_j ≤ τ, and
    x_j ≤ τ / w_j, for the largest weight is never zero. Of equal weights the first feature's counts. What the other
    features had to say is lost, and so is what the leaves said together: a D-SDT may act quite unlike its soft tree.

    The soft tree sees ``(x − shift) · scale``; this tree's thresholds undo the scaling exactly, and ``reading`` is
    what `extract_tree` takes: actions, names and bounds of the features, groups.
    """
    weights = np.asarray(actor.weights)
    feature = np.argmax(weights, axis=1)
    threshold = np.asarray(actor.thresholds) / np.take_along_axis(weights, feature[:, None], axis=1)[:, 0]
    return raw_tree(feature, threshold, np.asarray(actor.leaf_values), shift, scale, **metadata)
