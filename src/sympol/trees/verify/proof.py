"""Properties proven or refuted, exactly: the condition's boxes are sent down the tree, and each leaf is asked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ..base import BaseTree
from ..boxes import space
from .arrivals import Arrivals, acted, numbers, send
from .language import Rule, parse_rule
from .logic import Condition, boxes_of, satisfied
from .monotone import is_against, pair_against
from .properties import Property, Said, properties
from .terms import Monotone
from .verdict import Verdict, example, simplest

if TYPE_CHECKING:
    from jaxtyping import Float32


def verify(tree: BaseTree, said: Iterable[Said]) -> tuple[Verdict, ...]:
    """Prove properties, or find an observation against each.

    Args:
        tree: The policy.
        said: Rules, `Property` objects, and paths of files of properties.

    Raises:
        OSError: if a file cannot be read.
        ValueError: if a rule is none, or names what the tree does not have.
    """
    asked = [(one, _parsed(one, tree)) for one in properties(said)]
    return tuple(_prove(tree, one, rule) for one, rule in asked)


def _parsed(one: Property, tree: BaseTree) -> Rule:
    try:
        return parse_rule(one.rule, tree)
    except ValueError as error:
        named = "" if one.name == one.rule else f"property {one.name!r}: "
        raise ValueError(f"{named}{error}") from None


def _prove(tree: BaseTree, one: Property, rule: Rule) -> Verdict:
    start = space(tree, bounds=one.within_bounds)
    where = boxes_of(rule.condition, start)
    if not len(where):
        return Verdict(one.name, one.rule, holds=True, vacuous=True)
    ends = send(where, tree)
    if isinstance(rule.claim, Monotone):
        leaves, found = pair_against(tree, rule.claim, ends)
        against = not found or is_against(tree, rule.claim, found)
    else:
        leaves, found = _observation_against(tree, rule.claim, ends)
        against = not found or not satisfied(rule.claim, acted(tree, found)).any()
    for x in found:
        against &= bool(satisfied(rule.condition, x[None])[0] and start.contains(x[None])[0, 0])
    if not against:
        raise RuntimeError(
            f"sympol was about to give a wrong counterexample to {one.rule!r}; please report it"
        )
    return Verdict(
        one.name,
        one.rule,
        holds=not found,
        n_leaves=len(np.unique(ends.leaf)),
        n_violating=len(leaves),
        examples=tuple(example(tree, x) for x in found),
    )


def _observation_against(
    tree: BaseTree, claim: Condition, ends: Arrivals
) -> tuple[np.ndarray, list[Float32[np.ndarray, " features"]]]:
    """The leaves of which a claim is not true, and the simplest observation that ends there, if there is any."""
    wrong = satisfied(claim, numbers(tree, ends.leaf), negated=True)
    if not wrong.any():
        return ends.leaf[wrong], []
    boxes = ends.boxes[wrong]
    return np.unique(ends.leaf[wrong]), [boxes.some_observation(simplest(boxes))]
