"""Edits of a tree: each function returns a new tree and leaves the old one as it is.

Nodes are numbered in preorder, as in the arrays: after `cut` or `graft` the nodes behind the change have other
numbers. Names, bounds, groups, actions and ``meta`` stay. Visits are dropped, because a policy that acts
differently visits other states: `DecisionTree.with_visits` counts again.
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

    Args:
        tree: The tree.
        leaf: The number of a leaf.
        action: A name or a number; an option for each component; numbers where it is continuous. A discrete
            action gets the probability `sympol.trees.name_lookup.SURE`.

    Returns:
        The edited tree.

    Raises:
        ValueError: If there is no such leaf or action.
        TypeError: If the leaf or the action is of another type.
    """
    value = tree.leaf_outputs.copy()
    value[require_leaf(tree, leaf)] = leaf_value(tree.actions, action)
    return replace(tree, value=value, n_node_samples=None)


def set_threshold(tree: TreeT, node: int, threshold: float) -> TreeT:
    """Return the tree in which an inner node compares with another threshold, rounded to float32.

    Args:
        tree: The tree.
        node: The number of an inner node.
        threshold: A number that is finite in float32.

    Returns:
        The edited tree.

    Raises:
        ValueError: If there is no such inner node, or the threshold is not finite.
        TypeError: If the node or the threshold is not a number.
    """
    thresholds = tree.threshold.copy()
    thresholds[require_split(tree, node)] = checked_threshold(threshold)
    return replace(tree, threshold=thresholds, n_node_samples=None)


def set_feature(tree: TreeT, node: int, feature: str | int) -> TreeT:
    """Return the tree in which an inner node compares another feature.

    Args:
        tree: The tree.
        node: The number of an inner node.
        feature: The name or the position of a feature.

    Returns:
        The edited tree.

    Raises:
        ValueError: If there is no such inner node or feature.
        TypeError: If the node or the feature is of another type.
    """
    features = tree.feature.copy()
    features[require_split(tree, node)] = feature_position(tree, feature)
    return replace(tree, feature=features, n_node_samples=None)


def cut(tree: TreeT, node: int, action: Action | None = None) -> TreeT:
    """Return the tree in which an inner node and all below it become one leaf.

    Args:
        tree: The tree.
        node: The number of an inner node.
        action: The action of the new leaf. By default the action of most visits below the node, or of most leaves
            where visits are unknown or zero; the outputs are those of the most visited leaf with this action.

    Returns:
        The edited tree.

    Raises:
        ValueError: If there is no such inner node or action.
        TypeError: If the node or the action is of another type.
    """
    end = subtree_end(tree, require_split(tree, node))
    value = _common_value(tree, node, end) if action is None else leaf_value(tree.actions, action)
    return _replaced(tree, node, leaf_tree(tree, value))


def graft(tree: TreeT, node: int, other: TreeT) -> TreeT:
    """Return the tree in which another tree replaces a node and all below it.

    Args:
        tree: The tree.
        node: The number of a node.
        other: A tree of the same features, groups and actions.

    Returns:
        The edited tree.

    Raises:
        ValueError: If there is no such node, or the trees are of different spaces.
        TypeError: If the node is not a whole number.
    """
    require_same_space(tree, other)
    return _replaced(tree, require_node(tree, node), other)


def graft_all(tree: TreeT, parts: Iterable[tuple[int, TreeT]]) -> TreeT:
    """Return the tree with several grafts.

    Args:
        tree: The tree.
        parts: Pairs of a node and the tree that replaces it. Of nested nodes only the outer one counts.

    Returns:
        The edited tree.

    Raises:
        ValueError: As `graft` does.
        TypeError: As `graft` does.
    """
    for node, other in sorted(parts, key=lambda part: -part[0]):  # from behind: the others keep their numbers
        tree = graft(tree, node, other)
    return tree


def subtree(tree: TreeT, node: int) -> TreeT:
    """Return a node and all below it as a tree of its own.

    Args:
        tree: The tree.
        node: The number of the node that becomes the root.

    Returns:
        The subtree, with its visits.

    Raises:
        ValueError: If there is no such node.
        TypeError: If the node is not a whole number.
    """
    node = require_node(tree, node)
    part = slice(node, subtree_end(tree, node))
    visits = None if tree.n_node_samples is None else tree.n_node_samples[part]
    arrays = {name: getattr(tree, name)[part] for name in ("feature", "threshold", "value")}
    links = {name: getattr(tree, name)[part] for name in _LINKS}
    links = {name: np.where(link == NO_CHILD, NO_CHILD, link - node) for name, link in links.items()}
    return replace(tree, **arrays, **links, n_node_samples=visits)


def leaf_tree(tree: TreeT, value: Float32[np.ndarray, " outputs"]) -> TreeT:
    """Return a tree of the same space that is one leaf with these outputs, [outputs]."""
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
    """Return the tree whose root splits between two trees of the same space.

    Its visits are those of both, where both are known.
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
    """Return the first node behind the subtree of ``node``, which is ``slice(node, end)`` of the arrays."""
    while tree.children_right[node] != NO_CHILD:
        node = int(tree.children_right[node])
    return node + 1


def require_node(tree: BaseTree, node: int) -> int:
    """Return the number of a node as an int. Raises ValueError or TypeError if there is no such node."""
    if isinstance(node, bool) or not isinstance(node, int | np.integer):
        raise TypeError(f"a node is a whole number, got {node!r}")
    if not 0 <= node < tree.n_nodes:
        raise ValueError(f"a node must be from 0 to {tree.n_nodes - 1}, got {node}")
    return int(node)


def require_leaf(tree: BaseTree, node: int) -> int:
    """Return the number of a leaf as an int. Raises ValueError or TypeError if there is no such leaf."""
    if not tree.is_leaf[require_node(tree, node)]:
        raise ValueError(
            f"node {node} is no leaf: it asks, and does not answer; cut it first, or choose one of "
            f"{_some(np.flatnonzero(tree.is_leaf))}"
        )
    return int(node)


def require_split(tree: BaseTree, node: int) -> int:
    """Return the number of an inner node as an int. Raises ValueError or TypeError if there is no such node."""
    if tree.is_leaf[require_node(tree, node)]:
        raise ValueError(
            f"node {node} is a leaf, which asks nothing: {', '.join(leaf_words(tree, node))}; inner nodes are "
            f"{_some(np.flatnonzero(~tree.is_leaf))}"
        )
    return int(node)


def checked_threshold(threshold: float) -> float:
    """Return a threshold rounded to float32. Raises ValueError or TypeError unless it is a finite number."""
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
    """Raise ValueError unless two trees have the same features, groups and actions."""
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
    """Return the tree with ``part`` in place of the subtree of ``node``, which is one slice of the arrays."""
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
