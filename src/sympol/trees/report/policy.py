"""A tree as the page needs it: its nodes with the words, colours and pictures of each, its features, its programs."""

from __future__ import annotations

import base64
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..actions import BoxActions, MultiDiscreteActions
from ..base import BaseTree
from ..floats import number, printable, shortest
from ..plot import COLOURS, leaf_colours
from ..plot_boxes import readable_on
from ..plot_grid_view import glyph, view_side
from ..text import Choice, asked_group, leaf_conditions, leaf_words, question, rule_words
from .features import features_data, importance

if TYPE_CHECKING:
    from jaxtyping import Float32

    from ..text import Conditions

DIGITS = 4
"""Significant digits of thresholds in the picture; sentences and programs have them exactly."""
MOST_NODES, MOST_FEATURES = 5000, 2000
_MOST_OF_A_SCALE = 7


def policy_data(tree: BaseTree, seen: Float32[np.ndarray, "batch features"] | None = None) -> dict[str, Any]:
    """Describe a tree for the page; ``seen`` are visited observations, which the sliders have to reach.

    Raises:
        ValueError: more nodes or features than a page can show.
    """
    if tree.n_features > MOST_FEATURES:
        raise ValueError(f"at most {MOST_FEATURES} features can be shown in a page, got {tree.n_features}")
    if tree.n_nodes > MOST_NODES:
        raise ValueError(
            f"at most {MOST_NODES} nodes can be shown in a page, got {tree.n_nodes}; prune the tree first"
        )
    leaves = {leaf: (rule_words(tree, leaf, known), {**known}) for leaf, known in leaf_conditions(tree)}
    colours = leaf_colours(tree)
    nodes = [
        _leaf(tree, node, *leaves[node], colours[node]) if leaf else _inner(tree, node)
        for node, leaf in enumerate(tree.is_leaf)
    ]
    return {
        "nodes": nodes,
        "order": list(leaves),
        "visits": None if tree.n_node_samples is None else tree.n_node_samples.tolist(),
        "features": features_data(tree, seen),
        "groups": [
            {
                "name": printable(group.name),
                "features": group.features,
                "categories": [printable(category) for category in group.categories],
            }
            for group in tree.groups
        ],
        "side": view_side(tree.groups),
        "glyphs": _glyphs(tree),
        "legend": _legend(tree, colours),
        "importance": importance(tree),
        "depth": tree.depth,
    }


def packed(observations: Float32[np.ndarray, "steps features"]) -> str:
    """Write observations row by row as little-endian float32 in base64: exact, and half as long as digits."""
    return base64.b64encode(np.ascontiguousarray(observations, dtype="<f4").tobytes()).decode()


def _inner(tree: BaseTree, node: int) -> dict[str, Any]:
    asked, group = question(tree, node, DIGITS), asked_group(tree, node)
    feature = int(tree.feature[node])
    described: dict[str, Any] = {
        "feature": feature,
        "threshold": shortest(tree.threshold[node]),
        "left": int(tree.children_left[node]),
        "right": int(tree.children_right[node]),
        "yes": asked.yes_child,
        "words": question(tree, node).words,
    }
    if group is None:
        name = printable(tree.feature_names[feature])
        return described | {"lines": [name, f"≤ {number(tree.threshold[node], DIGITS)}"]}
    described["lines"] = [asked.words]
    if group.cell is not None:
        category = group.categories[group.features.index(feature)]
        described["view"] = {"cell": group.cell, "glyph": _seen_in_cells(tree).index(category)}
    return described


def _leaf(
    tree: BaseTree, leaf: int, rule: str, known: Conditions, colours: tuple[str, ...]
) -> dict[str, Any]:
    words = leaf_words(tree, leaf, DIGITS)
    return {
        "lines": words,
        "words": ", ".join(leaf_words(tree, leaf)),
        "colours": [[colour, readable_on(colour)] for colour in colours],
        "rule": rule,
        "region": [_condition(about, condition) for about, condition in known.items()],
        "answer": _answer(tree, leaf, colours),
    }


def _condition(about: Any, condition: Any) -> dict[str, Any]:
    """Describe one condition of a region; an interval comes with its ends, which are drawn."""
    if isinstance(condition, Choice):
        return {"words": condition.words()}
    above, most = (None if end is None else shortest(end) for end in (condition.above, condition.most))
    return {"words": condition.words(), "feature": about, "above": above, "most": most}


def _answer(tree: BaseTree, leaf: int, colours: tuple[str, ...]) -> list[dict[str, Any]]:
    """Describe the action of a leaf, component by component: probabilities of options, or a number in its range."""
    actions, value = tree.actions, tree.leaf_outputs[leaf : leaf + 1]
    if isinstance(actions, BoxActions):
        return _numbers(actions, np.ravel(actions.decide(value)), colours)
    chances = actions.probabilities(value)
    if isinstance(actions, MultiDiscreteActions):
        parts = zip(actions.names, actions.options, chances, strict=True)
    else:
        parts = [("", actions.names, chances)]
    return [
        {
            "name": printable(name),
            "bars": [
                [printable(option), round(float(chance), 6), _colour(i)]
                for i, (option, chance) in enumerate(zip(options, of_options[0], strict=True))
            ],
        }
        for name, options, of_options in parts
    ]


def _numbers(
    actions: BoxActions, decided: Float32[np.ndarray, " numbers"], colours: tuple[str, ...]
) -> list[dict[str, Any]]:
    stds = actions.std or (None,) * actions.n_outputs
    parts = zip(actions.names, decided, actions.low, actions.high, stds, colours, strict=True)
    return [
        {
            "name": printable(name),
            "value": shortest(value),
            "words": number(value, DIGITS) + ("" if std is None else f" ± {number(std, 2)} noise"),
            "low": _finite(low),
            "high": _finite(high),
            "colour": colour,
        }
        for name, value, low, high, std, colour in parts
    ]


def _legend(tree: BaseTree, colours: list[tuple[str, ...]]) -> list[dict[str, Any]]:
    """Return the colour of each action; for continuous ones a scale from the least to the largest."""
    actions = tree.actions
    if isinstance(actions, BoxActions):
        decided = tree.leaf_actions.reshape(tree.n_nodes, -1)
        return [
            {"name": printable(name), "options": _scale(decided[:, k], tree, [c[k] for c in colours])}
            for k, name in enumerate(actions.names)
        ]
    components = actions.options if isinstance(actions, MultiDiscreteActions) else (actions.names,)
    names = actions.names if isinstance(actions, MultiDiscreteActions) else ("",)
    return [
        {
            "name": printable(name),
            "options": [[printable(option), _colour(i)] for i, option in enumerate(options)],
        }
        for name, options in zip(names, components, strict=True)
    ]


def _scale(decided: Float32[np.ndarray, " nodes"], tree: BaseTree, colours: list[str]) -> list[list[str]]:
    values, leaves = np.unique(decided[tree.is_leaf], return_index=True)
    chosen = np.unique(np.linspace(0, len(values) - 1, _MOST_OF_A_SCALE).round().astype(int))
    nodes = np.flatnonzero(tree.is_leaf)[leaves]
    return [[number(float(values[i]), DIGITS), colours[nodes[i]]] for i in chosen]


def _glyphs(tree: BaseTree) -> list[dict[str, Any]]:
    """Draw every category that there is in a cell, as lines through points of the unit square."""
    return [{"category": printable(category), "lines": _lines(category)} for category in _seen_in_cells(tree)]


def _seen_in_cells(tree: BaseTree) -> list[str]:
    return list(dict.fromkeys(c for group in tree.groups if group.cell for c in group.categories))


def _lines(category: str) -> list[dict[str, Any]]:
    return [
        {
            "points": np.round(line.points, 3).tolist(),
            "fill": line.fill,
            "line": line.line,
            "width": line.width,
        }
        for line in glyph(category)
    ]


def _colour(option: int) -> str:
    return COLOURS[option % len(COLOURS)]


def _finite(x: float) -> float | None:
    return shortest(x) if math.isfinite(x) else None
