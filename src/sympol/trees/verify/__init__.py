"""Exact proofs about trees: a property holds for every observation, or an observation refutes it.

All observations that end in a leaf are a box, so a claim about all observations is a claim about finitely many boxes.
`properties` says what can be claimed and how it is answered, `scanner` and `grammar` parse rules, `conditions` turns
them into boxes and sends these down a tree, and `checks`, `possible` and `robustness` look at where they end.
"""

from ..boxes import unreachable_leaves
from .checks import equal, verify
from .possible import action_range, action_regions, possible_actions
from .properties import Example, Property, Verdict, read_properties
from .robustness import Margins, Noise, margin, noise

__all__ = [
    "Example",
    "Margins",
    "Noise",
    "Property",
    "Verdict",
    "action_range",
    "action_regions",
    "equal",
    "margin",
    "noise",
    "possible_actions",
    "read_properties",
    "unreachable_leaves",
    "verify",
]
