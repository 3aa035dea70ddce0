"""Exact explanations of single decisions.

`explain` gives three answers: the path through the tree as one sentence, the smallest part of the observation that
forces the action (`sufficient_reason`), and for every other action the nearest observation that gets it
(`counterfactual`). Nothing is sampled or fitted.
"""

from .counterfactual import NORMS, Counterfactual, Norm, nearest
from .explanation import Explanation, explain
from .neighborhood import ExplanationFeature, explanation_features, feature_indices
from .sufficient_reason import Reason

__all__ = [
    "NORMS",
    "Counterfactual",
    "Explanation",
    "ExplanationFeature",
    "Norm",
    "Reason",
    "explain",
    "explanation_features",
    "feature_indices",
    "nearest",
]
