"""Trees as text: a listing that follows the tree, and one sentence a leaf.

``≤`` is the tree's own comparison of float32 numbers, and ``>`` is its opposite: where an observation is NaN,
the answer is no.
"""

from __future__ import annotations

from .floats import number, printable
from .tree import DecisionTree


def to_text(tree: DecisionTree, *, digits: int | None = None) -> str:
    """Write the tree as a listing, an answer a line, with the share of visits where they are known.

    Thresholds are written in the fewest digits that give the same float32 back, or in ``digits`` significant
    ones. The text has no line break at its end.
    """
    lines: list[tuple[str, str]] = []
    awaited = [(0, "", "")]
    while awaited:
        node, head, indent = awaited.pop()
        lines.append((head + node_words(tree, node, digits), visit_share(tree, node)))
        if not tree.is_leaf[node]:
            left, right = int(tree.children_left[node]), int(tree.children_right[node])
            awaited.append((right, indent + "└─ no:  ", indent + "   "))
            awaited.append((left, indent + "├─ yes: ", indent + "│  "))
    width = max(len(line) for line, _ in lines)
    return "\n".join(f"{line:<{width}}  {share:>5}".rstrip() for line, share in lines)


def rules(tree: DecisionTree, *, digits: int | None = None) -> list[str]:
    """Write one sentence a leaf, from left to right; several conditions on a feature become one interval."""
    sentences: list[str] = []
    awaited: list[tuple[int, dict[int, tuple[float | None, float | None]]]] = [(0, {})]
    while awaited:
        node, known = awaited.pop()
        if tree.is_leaf[node]:
            conditions = " and ".join(
                _interval(printable(tree.feature_names[feature]), above, most, digits)
                for feature, (above, most) in known.items()
            )
            share = visit_share(tree, node)
            answer = node_words(tree, node, digits) + (f" ({share})" if share else "")
            sentences.append(f"If {conditions}: {answer}." if conditions else f"Always: {answer}.")
            continue
        feature, threshold = int(tree.feature[node]), float(tree.threshold[node])
        above, most = known.get(feature, (None, None))
        higher = threshold if above is None else max(above, threshold)
        lower = threshold if most is None else min(most, threshold)
        awaited.append((int(tree.children_right[node]), {**known, feature: (higher, most)}))
        awaited.append((int(tree.children_left[node]), {**known, feature: (above, lower)}))
    return sentences


def node_words(tree: DecisionTree, node: int, digits: int | None = None) -> str:
    """Say what an inner node asks, or what a leaf does."""
    if tree.is_leaf[node]:
        return ", ".join(leaf_words(tree, node, digits))
    return f"{printable(tree.feature_names[tree.feature[node]])} ≤ {number(tree.threshold[node], digits)}"


def leaf_words(tree: DecisionTree, leaf: int, digits: int | None = None) -> tuple[str, ...]:
    """Say what a leaf does, component by component."""
    return tree.actions.words(tree.actions.decide(tree.value[leaf : leaf + 1])[0], digits)


def visit_share(tree: DecisionTree, leaf: int) -> str:
    """Say how large a part of the visits ended at a leaf: ``62 %``; nothing where that is unknown."""
    visits = tree.n_node_samples
    if visits is None or visits[0] == 0 or not tree.is_leaf[leaf]:
        return ""
    share = float(visits[leaf] / visits[0])
    if 0 < share < 0.005:
        return "<1 %"
    return ">99 %" if 0.995 <= share < 1 else f"{share:.0%}".replace("%", " %")


def _interval(name: str, above: float | None, most: float | None, digits: int | None) -> str:
    if above is None:
        return f"{name} ≤ {number(most or 0.0, digits)}"
    if most is None:
        return f"{name} > {number(above, digits)}"
    return f"{number(above, digits)} < {name} ≤ {number(most, digits)}"
