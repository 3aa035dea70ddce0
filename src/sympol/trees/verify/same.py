"""Whether two trees act the same, and if not, where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..actions import BoxActions, DiscreteActions, MultiDiscreteActions
from ..base import BaseTree
from ..boxes import Boxes, space
from ..floats import printable
from .arrivals import acted, numbers, send
from .verdict import Example, Verdict, action_words, observation_words, simplest


def equal(tree: BaseTree, other: BaseTree, *, within_bounds: bool = True) -> Verdict:
    """Prove that two trees act the same on every observation, or find one on which they do not.

    Both are walked at once: what ends in a leaf of the one is sent down the other. Observations are those that
    both take: within the bounds of both, with the groups and whole numbers of either. The counterexample is the
    smallest in this sense: no other has fewer numbers that are not 0, and of the boxes in which that is so it is
    from the one nearest to 0.

    Raises:
        ValueError: if the two do not see the same features, or have other actions.
    """
    _require_same_kind(tree, other)
    ends = send(_common_space(tree, other, within_bounds), tree)
    of_other = send(ends.boxes, other)
    leaf = ends.leaf[of_other.origin]
    differs = (numbers(tree, leaf) != numbers(other, of_other.leaf)).any(axis=1)
    name, rule = "equal", "both trees act the same"
    n_leaves, n_violating = len(np.unique(leaf)), len(np.unique(leaf[differs]))
    if not differs.any():
        return Verdict(name, rule, holds=True, vacuous=n_leaves == 0, n_leaves=n_leaves)
    boxes = of_other.boxes[differs]
    x = boxes.some_observation(simplest(boxes))
    if (acted(tree, [x]) == acted(other, [x])).all():
        raise RuntimeError(
            f"sympol was about to say wrongly that two trees differ at {x.tolist()}; please report it"
        )
    action = f"{action_words(tree, x)}; the other: {action_words(other, x)}"
    return Verdict(
        name,
        rule,
        holds=False,
        n_leaves=n_leaves,
        n_violating=n_violating,
        examples=(Example(x, observation_words(tree, x), action),),
    )


def _require_same_kind(tree: BaseTree, other: BaseTree) -> None:
    if tree.feature_names != other.feature_names:
        pairs = zip(tree.feature_names, other.feature_names, strict=False)
        different = [f"{printable(a)!r} and {printable(b)!r}" for a, b in pairs if a != b]
        what = different[0] if different else f"{tree.n_features} and {other.n_features} of them"
        raise ValueError(
            f"the trees see other features: {what}; only trees of one environment can be compared"
        )
    if tree.groups and other.groups and tree.groups != other.groups:
        raise ValueError(
            "the trees see other groups of features; only trees of one environment can be compared"
        )
    if _kind(tree) != _kind(other):
        kinds = (" ".join(map(str, _kind(one))) for one in (tree, other))
        raise ValueError(f"the trees have other actions: {' and '.join(kinds)}; there is nothing to compare")


def _kind(tree: BaseTree) -> tuple[object, ...]:
    match tree.actions:
        case BoxActions(shape=shape):
            return ("numbers in the shape", *shape)
        case DiscreteActions(n=n, start=start):
            return (n, "actions from number", start)
        case MultiDiscreteActions(nvec=nvec, start=start):
            return (nvec, "options from number", start)


def _common_space(tree: BaseTree, other: BaseTree, within_bounds: bool) -> Boxes:
    one, two = space(tree, bounds=within_bounds), space(other, bounds=within_bounds)
    grouped = {feature for group in (*tree.groups, *other.groups) for feature in group.features}
    integers = tuple(sorted({*tree.integers, *other.integers} - grouped))
    return replace(one, groups=tree.groups or other.groups, integers=integers).intersect(two)
