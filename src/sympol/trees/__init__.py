"""The decision tree and what one does with it: NumPy only."""

from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .prune import prune, prune_unvisited
from .tree import DecisionTree

__all__ = [
    "ActionSpec",
    "BoxActions",
    "DecisionTree",
    "DiscreteActions",
    "MultiDiscreteActions",
    "prune",
    "prune_unvisited",
]
