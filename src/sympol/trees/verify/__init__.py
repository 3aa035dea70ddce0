"""Proofs about trees by the boxes of their leaves: what is said holds for every observation, or here is one."""

from ..boxes import unreachable_leaves
from .possible import action_range, possible_actions
from .proof import verify
from .properties import Property, read_properties
from .robustness import Margins, Noise, margin, noise
from .same import equal
from .verdict import Example, Verdict

__all__ = [
    "Example",
    "Margins",
    "Noise",
    "Property",
    "Verdict",
    "action_range",
    "equal",
    "margin",
    "noise",
    "possible_actions",
    "read_properties",
    "unreachable_leaves",
    "verify",
]
