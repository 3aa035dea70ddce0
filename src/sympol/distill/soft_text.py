"""Soft trees as text, drawn as `sympol.trees.text` draws hard ones."""

from __future__ import annotations

import numpy as np

from ..trees.actions import BoxActions, MultiDiscreteActions
from ..trees.floats import printable
from .soft_view import SoftView, percent

_MOST_OPTIONS = 3


def soft_text(view: SoftView, *, digits: int = 3) -> str:
    """Write a soft tree as a listing of its sums and comparisons, and of what each leaf would choose by itself.

    The features of a node are scaled, as described above the listing.

    Args:
        view: The soft tree.
        digits: The number of significant digits.

    Returns:
        The text, without a line break at its end.
    """
    n_inner = len(view.thresholds)
    lines: list[tuple[str, str]] = []
    awaited = [(0, "", "")]
    while awaited:
        node, head, indent = awaited.pop()
        if node >= n_inner:
            share = "" if view.shares is None else percent(float(view.shares[node - n_inner]))
            lines.append((head + leaf_words(view, node - n_inner, digits), share))
            continue
        lines.append((head + node_words(view, node, digits), ""))
        awaited.append((2 * node + 2, indent + "└─ no:  ", indent + "   "))
        awaited.append((2 * node + 1, indent + "├─ yes: ", indent + "│  "))
    width = max(len(line) for line, _ in lines)
    listing = [f"{line:<{width}}  {share:>5}".rstrip() for line, share in lines]
    return "\n".join([*legend(view), "", *listing])


def legend(view: SoftView) -> list[str]:
    """Explain how gates work, what leaves do, and how features are scaled.

    Args:
        view: The soft tree.

    Returns:
        The lines of the explanation.
    """
    return [
        "Every way is taken, each with a weight: yes and no count alike where a node's sum equals its threshold, and "
        f"from {view.reach:.3g} beyond it only one of them.",
        "The outputs of the leaves are averaged by the weights of the ways; a leaf shows what it alone would choose.",
        *(["The features are scaled. " + "; ".join(view.scaling()) + "."] if view.scaling() else []),
    ]


def node_words(view: SoftView, node: int, digits: int = 3) -> str:
    """Write the comparison of a node, such as ``0.62·pole angle + 0.38·pole velocity ≤ 0.031``, on scaled features.

    Args:
        view: The soft tree.
        node: The number of the node.
        digits: The number of significant digits.

    Returns:
        The text.
    """
    terms = [
        term.name if term.weight == 1 else f"{term.weight:.{digits}g}·{term.name}"
        for term in view.terms(node)
    ]
    return f"{' + '.join(terms)} ≤ {view.thresholds[node]:.{digits}g}"


def leaf_words(view: SoftView, leaf: int, digits: int = 3) -> str:
    """Write the likeliest options of a leaf with their probabilities, component by component; or its mean.

    Args:
        view: The soft tree.
        leaf: The number of the leaf.
        digits: The number of significant digits.

    Returns:
        The text.
    """
    values, actions = view.leaf_values[leaf : leaf + 1], view.actions
    if isinstance(actions, BoxActions):
        return ", ".join(actions.words(actions.decide(values)[0], digits))
    if isinstance(actions, MultiDiscreteActions):
        parts = zip(actions.names, actions.options, actions.probabilities(values), strict=True)
        return ", ".join(f"{printable(name)}: {_likeliest(options, p[0])}" for name, options, p in parts)
    return _likeliest(actions.names, actions.probabilities(values)[0])


def _likeliest(names: tuple[str, ...], chances: np.ndarray) -> str:
    order = [i for i in np.argsort(-chances, kind="stable") if chances[i] >= 0.005][:_MOST_OPTIONS]
    return ", ".join(f"{printable(names[i])} {percent(float(chances[i]))}" for i in order)
