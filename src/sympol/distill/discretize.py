"""D-SDT: a soft decision tree made hard (Silva et al. 2020, arXiv:1903.09338)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..functional.float32_order import unscale_thresholds
from ..policies.soft_tree import SoftTree
from ..trees import DecisionTree
from ..trees.actions import ActionSpec
from ..trees.groups import Group


def discretize(
    actor: SoftTree,
    shift: np.ndarray,
    scale: np.ndarray,
    *,
    actions: ActionSpec,
    feature_names: Sequence[str],
    feature_low: np.ndarray,
    feature_high: np.ndarray,
    groups: Sequence[Group] = (),
) -> DecisionTree:
    """The complete hard tree that keeps of each node its heaviest feature, and of each gate its likelier way.

    A gate is more than half open to the left where w · x < τ. With all weight on feature j that is x_j · w_j ≤ τ, and
    x_j ≤ τ / w_j, for the largest weight is never zero. Of equal weights the first feature's counts. What the other
    features had to say is lost, and so is what the leaves said together: a D-SDT may act quite unlike its soft tree.

    The soft tree sees ``(x − shift) · scale``; this tree's thresholds undo the scaling exactly, as `extract_tree` does.
    """
    weights = np.asarray(actor.weights)
    feature = np.argmax(weights, axis=1)
    threshold = np.asarray(actor.thresholds) / np.take_along_axis(weights, feature[:, None], axis=1)[:, 0]
    return DecisionTree.from_complete(
        feature,
        unscale_thresholds(threshold, np.asarray(shift)[feature], np.asarray(scale)[feature]),
        np.asarray(actor.leaf_values),
        actions=actions,
        feature_names=feature_names,
        feature_low=feature_low,
        feature_high=feature_high,
        groups=groups,
    )
