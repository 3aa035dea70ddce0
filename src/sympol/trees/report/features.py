"""Features as the page needs them: the range of each one's slider, and how often the tree asks for it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import BaseTree
from ..floats import printable, shortest
from ..groups import Group
from ..text import asked_group

if TYPE_CHECKING:
    from jaxtyping import Float32

_BEYOND = 0.2
"""How much further than what was seen a slider goes, as a part of its range."""


def features_data(tree: BaseTree, seen: Float32[np.ndarray, "batch features"] | None) -> list[dict[str, Any]]:
    """Describe each feature: name, range of its slider, where the tree splits, whether it is a whole number."""
    return [
        {
            "name": printable(name),
            "low": low,
            "high": high,
            "integer": i in tree.integers,
            "splits": [shortest(t) for t in np.unique(tree.threshold[tree.feature == i])],
        }
        for i, (name, (low, high)) in enumerate(zip(tree.feature_names, _ranges(tree, seen), strict=True))
    ]


def _ranges(tree: BaseTree, seen: Float32[np.ndarray, "batch features"] | None) -> list[tuple[float, float]]:
    """Take what was seen and where the tree splits, and some more, within the bounds of the space.

    Bounds alone are often so far out that all that matters lies in one notch of a slider. Where nothing was seen
    they are the range.
    """
    ranges = []
    for i in range(tree.n_features):
        low, high = float(tree.feature_low[i]), float(tree.feature_high[i])
        known = tree.threshold[tree.feature == i]
        known = np.concatenate([known, [low, high] if seen is None else seen[:, i]])
        known = known[np.isfinite(known)].astype(np.float64)
        least, most = (float(known.min()), float(known.max())) if known.size else (-1.0, 1.0)
        beyond = _BEYOND * (most - least) if most > least else max(1.0, abs(most))
        ranges.append((shortest(max(low, least - beyond)), shortest(min(high, most + beyond))))
    return ranges


def importance(tree: BaseTree) -> list[dict[str, Any]] | None:
    """Return for each feature, or group, the share of decisions that ask for it; None without visits.

    A decision asks for a feature if a comparison on its way does; that it does so twice changes nothing. The
    shares therefore add up to more than one.
    """
    visits = tree.n_node_samples
    if visits is None or visits[0] == 0:
        return None
    asked: dict[int | Group, int] = {}
    awaited: list[tuple[int, frozenset[int | Group]]] = [(0, frozenset())]
    while awaited:
        node, above = awaited.pop()
        if tree.is_leaf[node]:
            continue
        about = asked_group(tree, node) or int(tree.feature[node])
        if about not in above:
            asked[about] = asked.get(about, 0) + int(visits[node])
        children = int(tree.children_left[node]), int(tree.children_right[node])
        awaited += [(child, above | {about}) for child in children]
    ordered = sorted(asked.items(), key=lambda item: -item[1])
    return [{"name": _name(tree, about), "share": n / int(visits[0])} for about, n in ordered]


def _name(tree: BaseTree, about: int | Group) -> str:
    if isinstance(about, Group):
        return printable(about.name) or " / ".join(printable(category) for category in about.categories)
    return printable(tree.feature_names[about])
