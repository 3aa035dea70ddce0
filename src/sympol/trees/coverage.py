"""Which part of a tree a condition is about: the nodes that decide wherever it holds."""

from __future__ import annotations

import numpy as np

from .base import BaseTree
from .boxes import node_boxes, space
from .verify.conditions import boxes_of
from .verify.grammar import parse_condition


def nodes_met(tree: BaseTree, condition: str) -> tuple[int, ...]:
    """Return the nodes that observations come by of which a condition holds, in the order of the tree.

    The condition is a property's ``when``: ``"pole angle > 0.1 and cart velocity > 0"``. As long as these nodes stay
    as they are, the tree does wherever the condition holds what it does now.

    Raises:
        ValueError: the condition is none, names what the tree does not have, or can never hold.
    """
    meant = boxes_of(parse_condition(condition, tree), space(tree, bounds=False))
    if not len(meant):
        raise ValueError(f"no observation meets the condition {condition!r}")
    nodes = node_boxes(tree, bounds=False)
    met = np.zeros(tree.n_nodes, bool)
    for box in range(len(meant)):
        met |= ~nodes.intersect(meant[[box]]).is_empty
    return tuple(np.flatnonzero(met).tolist())
