"""Pure functions on arrays: no state, no classes."""

from .entmax import entmax15
from .hard_tree import hard_tree, leaf_index, select

__all__ = ["entmax15", "hard_tree", "leaf_index", "select"]
