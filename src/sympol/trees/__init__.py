"""Decision trees as policies: their data, and functions that read, change, prove and export them. NumPy only."""

from .actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from .groups import Group
from .prune import prune, prune_on, prune_unvisited
from .tree import DecisionTree

__all__ = [
    "ActionSpec",
    "BoxActions",
    "DecisionTree",
    "DiscreteActions",
    "Group",
    "MultiDiscreteActions",
    "prune",
    "prune_on",
    "prune_unvisited",
]
