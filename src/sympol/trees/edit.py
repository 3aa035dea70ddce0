"""Changing a tree by hand: each function returns a new one, the old one stays as it is.

Nodes are numbered in preorder, as the arrays are, and a new tree counts anew: after `cut` or `graft` the nodes
behind the change have other numbers. Names, bounds, groups, actions and ``meta`` stay. What is not known of the
new tree is how often its nodes are visited, above the change no less than below it, because a policy that acts
otherwise goes elsewhere: `DecisionTree.with_visits` counts again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .actions import BoxActions
from .base import BaseTree, TreeT
from .floats import brief, flushed
from .name_lookup import Action, feature_position, leaf_value
from .preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD
from .text import leaf_words

if TYPE_CHECKING:
    from jaxtyping import Float32

_LINKS = ("children_left", "children_right")


def set_action(tree: TreeT, leaf: int, action: Action) -> TreeT:
    """Return the tree in which a leaf takes another action.

    The action is a name or a number; options for each component; numbers where it is continuous. The leaf's
    probabilities become `sympol.trees.name_lookup.SURE` for it.

    Raises:
        ValueError, TypeError: no such leaf, or no such action.
    """
    value = tree.leaf_outputs.copy()
    value[require_leaf(tree, leaf)] = leaf_value(tree.actions, action)
    return replace(tree, value=value, n_node_samples=None)


def set_threshold(tree: TreeT, node: int, threshold: float) -> TreeT:
    """Return the tree in which an inner node compares with another threshold, rounded to float32.

    Raises:
        ValueError, TypeError: no such inner node, or no finite number.
    """
    thresholds = tree.threshold.copy()
    thresholds[require_split(tree, node)] = checked_threshold(threshold)
    return replace(tree, threshold=thresholds, n_node_samples=None)


def set_feature(tree: TreeT, node: int, feature: str | int) -> TreeT:
    """Return the tree in which an inner node looks at another feature, given by name or position.

    Raises:
        ValueError, TypeError: no such inner node, or no such feature.
    """
    features = tree.feature.copy()
    features[require_split(tree, node)] = feature_position(tree, feature)
    return replace(tree, feature=features, n_node_samples=None)


def cut(tree: TreeT, node: int, action: Action | None = None) -> TreeT:
    """Return the tree in which an inner node and all below it became one leaf.

    Without an ``action`` it takes the one most visits below it ended in, or, where visits are not known or there
    are none, the one of most leaves; the leaf is then the most visited of those that take it. Of equals, the
    first.

    Raises:
        ValueError, TypeError: no such inner node, or no such action.
    """
    end = subtree_end(tree, require_split(tree, node))
    value = _common_value(tree, node, end) if action is None else leaf_value(tree.actions, action)
    return _replaced(tree, node, leaf_tree(tree, value))


def graft(tree: TreeT, node: int, other: TreeT) -> TreeT:
    """Return the tree in which another one stands in the place of a node, and of all below it.

    Raises:
        ValueError, TypeError: no such node, or the trees are not of the same features, groups and actions.
    """
    require_same_space(tree, other)
    return _replaced(tree, require_node(tree, node), other)


def graft_all(tree: TreeT, parts: Iterable[tuple[int, TreeT]]) -> TreeT:
    """Return the tree with all of these grafts: each a node and what stands in its place. Of one within another only
    the outer counts.

    Raises:
        ValueError, TypeError: as `graft` does.
    """
    for node, other in sorted(parts, key=lambda part: -part[0]):  # from behind: the others keep their numbers
        tree = graft(tree, node, other)
    return tree


def subtree(tree: TreeT, node: int) -> TreeT:
    """Return what is below a node, the node included, as a tree of its own.

    Raises:
        ValueError, TypeError: no such node.
    """
    node = require_node(tree, node)
    part = slice(node, subtree_end(tree, node))
    visits = None if tree.n_node_samples is None else tree.n_node_samples[part]
    arrays = {name: getattr(tree, name)[part] for name in ("feature", "threshold", "value")}
    links = {name: getattr(tree, name)[part] for name in _LINKS}
    links = {name: np.where(link == NO_CHILD, NO_CHILD, link - node) for name, link in links.items()}
    return replace(tree, **arrays, **links, n_node_samples=visits)


def leaf_tree(tree: TreeT, value: Float32[np.ndarray, " outputs"]) -> TreeT:
    """Return a tree of the same space that is one leaf."""
    return replace(
        tree,
        children_left=[NO_CHILD],
        children_right=[NO_CHILD],
        feature=[NO_FEATURE],
        threshold=[NO_THRESHOLD],
        value=np.reshape(value, (1, -1)),
        n_node_samples=None,
    )


def split_tree(feature: int, threshold: float, left: TreeT, right: TreeT) -> TreeT:
    """Return the tree that asks one question and goes on with one of two trees of the same space.

    Its visits are those of both, where both know theirs.
    """
    visits, (ours, theirs) = None, (left.n_node_samples, right.n_node_samples)
    if ours is not None and theirs is not None:
        visits = np.concatenate([[ours[0] + theirs[0]], ours, theirs])
    links = {}
    for name, root in zip(_LINKS, (1, 1 + left.n_nodes), strict=True):
        halves = (
            np.where(link == NO_CHILD, NO_CHILD, link + start)
            for link, start in ((getattr(left, name), 1), (getattr(right, name), 1 + left.n_nodes))
        )
        links[name] = np.concatenate([[root], *halves])
    return replace(
        left,
        **links,
        feature=np.concatenate([[feature], left.feature, right.feature]),
        threshold=np.concatenate([[threshold], left.threshold, right.threshold]),
        value=np.concatenate([np.zeros((1, left.actions.n_outputs)), left.leaf_outputs, right.leaf_outputs]),
        n_node_samples=visits,
    )


def subtree_end(tree: BaseTree, node: int) -> int:
    """Return the first node behind those below ``node``."""
    while tree.children_right[node] != NO_CHILD:
        node = int(tree.children_right[node])
    return node + 1


def require_node(tree: BaseTree, node: int) -> int:
    """Return a node's number. Raises ValueError or TypeError where it is none."""
    if isinstance(node, bool) or not isinstance(node, int | np.integer):
        raise TypeError(f"a node is a whole number, got {node!r}")
    if not 0 <= node < tree.n_nodes:
        raise ValueError(f"a node must be from 0 to {tree.n_nodes - 1}, got {node}")
    return int(node)


def require_leaf(tree: BaseTree, node: int) -> int:
    """Return a leaf's number. Raises ValueError or TypeError where it is none."""
    if not tree.is_leaf[require_node(tree, node)]:
        raise ValueError(
            f"node {node} is no leaf: it asks, and does not answer; cut it first, or choose one of "
            f"{_some(np.flatnonzero(tree.is_leaf))}"
        )
    return int(node)


def require_split(tree: BaseTree, node: int) -> int:
    """Return an inner node's number. Raises ValueError or TypeError where it is none."""
    if tree.is_leaf[require_node(tree, node)]:
        raise ValueError(
            f"node {node} is a leaf, which asks nothing: {', '.join(leaf_words(tree, node))}; inner nodes are "
            f"{_some(np.flatnonzero(~tree.is_leaf))}"
        )
    return int(node)


def checked_threshold(threshold: float) -> float:
    """Return a threshold as float32 has it. Raises ValueError or TypeError where it is no finite number."""
    if (
        isinstance(threshold, bool | str)
        or np.ndim(threshold)
        or np.asarray(threshold).dtype.kind not in "fiu"
    ):
        raise TypeError(f"a threshold is a number, got {threshold!r}")
    rounded = float(flushed(threshold))
    if not math.isfinite(rounded):
        raise ValueError(f"a threshold must be finite in float32, got {threshold!r}")
    return rounded


def require_same_space(tree: BaseTree, other: BaseTree) -> None:
    """Raise ValueError unless two trees see the same features, in the same groups, and choose the same actions."""
    pairs = {
        "features": (tree.feature_names, other.feature_names),
        "groups": (tree.groups, other.groups),
        "whole numbers": (tree.integers, other.integers),
        "actions": (_without_noise(tree), _without_noise(other)),
    }
    for what, (ours, theirs) in pairs.items():
        if ours != theirs:
            raise ValueError(
                f"the trees must be of the same {what}, got {brief(ours, 200)} and {brief(theirs, 200)}"
            )


def _without_noise(tree: BaseTree) -> object:
    return replace(tree.actions, std=None) if isinstance(tree.actions, BoxActions) else tree.actions


def _some(nodes: np.ndarray) -> str:
    shown = ", ".join(map(str, nodes[:8].tolist()))
    return f"{shown}, …" if len(nodes) > 8 else shown or "none"


def _common_value(tree: BaseTree, node: int, end: int) -> Float32[np.ndarray, " outputs"]:
    leaves = np.arange(node, end)[tree.is_leaf[node:end]]
    visits = np.zeros(len(leaves)) if tree.n_node_samples is None else tree.n_node_samples[leaves]
    weights = visits if visits.any() else np.ones(len(leaves))
    chosen = [action.tobytes() for action in tree.leaf_actions[leaves]]
    totals = {action: 0.0 for action in chosen}
    for action, weight in zip(chosen, weights.tolist(), strict=True):
        totals[action] += weight
    common = max(totals, key=lambda action: totals[action])
    candidates = [i for i, action in enumerate(chosen) if action == common]
    return tree.leaf_outputs[leaves[max(candidates, key=lambda i: weights[i])]]


def _replaced(tree: TreeT, node: int, part: TreeT) -> TreeT:
    """The tree with ``part`` where the subtree of ``node`` was; every subtree is one slice of the arrays."""
    end = subtree_end(tree, node)
    grown = part.n_nodes - (end - node)

    def spliced(name: str) -> np.ndarray:
        ours, theirs = getattr(tree, name), getattr(part, name)
        if name in _LINKS:
            theirs = np.where(theirs == NO_CHILD, NO_CHILD, theirs + node)
            ours = np.where(ours >= end, ours + grown, ours)
        return np.concatenate([ours[:node], theirs, ours[end:]])

    names = (*_LINKS, "feature", "threshold", "value")
    return replace(tree, **{name: spliced(name) for name in names}, n_node_samples=None)
