"""Random mutations of a tree, for evolution.

While it is mutated, a tree is plain nested tuples, so that a mutation shares all unchanged subtrees. Thresholds are
drawn between observed values, where a split makes a difference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Float32

from ..trees import DecisionTree
from ..trees.actions import ActionSpec, BoxActions, DiscreteActions, MultiDiscreteActions
from ..trees.name_lookup import SURE
from ..trees.preorder import NO_CHILD, NO_FEATURE, NO_THRESHOLD

FEW = 32
"""A feature with fewer observed values has its thresholds moved from gap to gap, not by a continuous step."""


class Leaf(NamedTuple):
    """A leaf with its outputs, as in `DecisionTree.value`."""

    value: tuple[float, ...]


class Split(NamedTuple):
    """A split: ``x[feature] <= threshold`` goes left."""

    feature: int
    threshold: float
    left: NestedTree
    right: NestedTree


NestedTree: TypeAlias = Leaf | Split
Path: TypeAlias = tuple[bool, ...]
"""The path from the root to a node: for each split whether it goes right."""


def to_nested(tree: DecisionTree) -> NestedTree:
    """Return a tree as nested tuples."""
    nodes: list[NestedTree] = []
    for i in range(tree.n_nodes - 1, -1, -1):
        if tree.is_leaf[i]:
            nodes.append(Leaf(tuple(tree.leaf_outputs[i].tolist())))
        else:
            nodes.append(Split(int(tree.feature[i]), float(tree.threshold[i]), nodes.pop(), nodes.pop()))
    return nodes[0]


def from_nested(root: NestedTree, like: DecisionTree) -> DecisionTree:
    """Return the tree of nested tuples.

    Args:
        root: The nested tuples.
        like: A tree whose feature names, bounds and actions it has.

    Returns:
        The tree.
    """
    left, right, feature, threshold, value = [], [], [], [], []
    none = (0.0,) * like.actions.n_outputs

    def write(node: NestedTree) -> int:
        here = len(left)
        is_leaf = isinstance(node, Leaf)
        left.append(NO_CHILD)
        right.append(NO_CHILD)
        feature.append(NO_FEATURE if is_leaf else node.feature)
        threshold.append(NO_THRESHOLD if is_leaf else node.threshold)
        value.append(node.value if is_leaf else none)
        if not is_leaf:
            left[here] = write(node.left)
            right[here] = write(node.right)
        return here

    write(root)
    return replace(
        like,
        children_left=np.array(left),
        children_right=np.array(right),
        feature=np.array(feature),
        threshold=np.array(threshold, np.float32),
        value=np.array(value, np.float32),
        n_node_samples=None,
    )


def num_nodes(node: NestedTree) -> int:
    """Return the number of nodes, including leaves."""
    return 1 if isinstance(node, Leaf) else 1 + num_nodes(node.left) + num_nodes(node.right)


def nodes_with_paths(node: NestedTree, above: Path = ()) -> list[tuple[Path, NestedTree]]:
    """Return every node with its path.

    Args:
        node: The root of a subtree.
        above: The path to it.

    Returns:
        Pairs of path and node, each before those below it.
    """
    here: list[tuple[Path, NestedTree]] = [(above, node)]
    if isinstance(node, Split):
        here += nodes_with_paths(node.left, (*above, False)) + nodes_with_paths(node.right, (*above, True))
    return here


def replace_at(root: NestedTree, path: Path, new: NestedTree) -> NestedTree:
    """Return a tree with another subtree at the end of a path.

    Args:
        root: The tree.
        path: The path to the subtree that is replaced.
        new: The subtree that takes its place.

    Returns:
        The tree; it shares all other subtrees.
    """
    if not path:
        return new
    assert isinstance(root, Split)
    if path[0]:
        return root._replace(right=replace_at(root.right, path[1:], new))
    return root._replace(left=replace_at(root.left, path[1:], new))


@dataclass(frozen=True)
class Mutator:
    """A source of random mutations for one environment."""

    actions: ActionSpec
    seen: tuple[Float32[np.ndarray, " values"], ...]
    """The distinct observed values of each feature, sorted."""
    spread: tuple[float, ...]
    """The standard deviation of each feature."""

    @staticmethod
    def for_observations(actions: ActionSpec, observations: Float32[np.ndarray, "steps features"]) -> Mutator:
        """Return mutations that make a difference among some observations.

        Args:
            actions: The actions of the environment.
            observations: The observations ``[steps, features]``.

        Returns:
            The mutator.

        Raises:
            ValueError: All observations are the same, so that no split can tell them apart.
        """
        seen = tuple(np.unique(column) for column in observations.T)
        if all(len(values) < 2 for values in seen):
            raise ValueError(
                f"{len(observations)} observations are all the same: no split can tell them apart"
            )
        return Mutator(actions, seen, tuple(observations.std(axis=0).tolist()))

    @cached_property
    def splittable(self) -> list[int]:
        """The features of which a split makes a difference."""
        return [feature for feature, values in enumerate(self.seen) if len(values) > 1]

    def mutate(self, root: NestedTree, others: Sequence[NestedTree], rng: np.random.Generator) -> NestedTree:
        """Return a tree after one mutation or a few.

        Args:
            root: The tree.
            others: Trees to take subtrees from.
            rng: The generator that draws.

        Returns:
            The mutated tree.
        """
        for _ in range(rng.geometric(0.6)):
            root = self._mutate_once(root, others, rng)
        return root

    def random_leaf(self, rng: np.random.Generator) -> Leaf:
        """Return a leaf with a random action."""
        match self.actions:
            case DiscreteActions(n=n):
                return Leaf(_sure(n, int(rng.integers(n))))
            case MultiDiscreteActions(nvec=nvec):
                return Leaf(tuple(x for n in nvec for x in _sure(n, int(rng.integers(n)))))
            case BoxActions():
                return Leaf(tuple(rng.uniform(*self._range()).tolist()))

    def mutated_leaf(self, leaf: Leaf, rng: np.random.Generator) -> Leaf:
        """Return another leaf.

        Args:
            leaf: The leaf.
            rng: The generator that draws.

        Returns:
            A leaf with a random action if actions are discrete, mostly one with a close action if continuous.
        """
        if not isinstance(self.actions, BoxActions) or rng.random() < 0.2:
            return self.random_leaf(rng)
        low, high = self._range()
        step = rng.normal(size=low.shape) * (high - low) * 10 ** rng.uniform(-2.5, 0)
        return Leaf(tuple((np.asarray(leaf.value) + step).clip(low, high).tolist()))

    def _mutate_once(
        self, root: NestedTree, others: Sequence[NestedTree], rng: np.random.Generator
    ) -> NestedTree:
        everywhere = nodes_with_paths(root)
        splits = [(path, node) for path, node in everywhere if isinstance(node, Split)]
        leaves = [(path, node) for path, node in everywhere if isinstance(node, Leaf)]
        kind = _KINDS[int(np.searchsorted(_CUMULATED, rng.random(), side="right"))]  # faster than choice(p=…)
        if kind in _OF_SPLITS and splits:
            path, split = splits[rng.integers(len(splits))]
            return replace_at(root, path, self._mutated_split(split, kind, others, rng))
        path, leaf = leaves[rng.integers(len(leaves))]
        if kind == "action":
            return replace_at(root, path, self.mutated_leaf(leaf, rng))
        node: NestedTree = leaf
        if kind == "grow anywhere" and splits:
            path, node = everywhere[rng.integers(len(everywhere))]
        left, right = node, self.mutated_leaf(leaf, rng)
        if rng.random() < 0.5:
            left, right = right, left
        return replace_at(root, path, self._random_split(left, right, rng))

    def _mutated_split(
        self, split: Split, kind: str, others: Sequence[NestedTree], rng: np.random.Generator
    ) -> NestedTree:
        match kind:
            case "threshold" if len(self.seen[split.feature]) > 2:
                return split._replace(threshold=self._near(split, rng))
            case "threshold" | "split":  # a single gap between values has no other threshold
                return self._random_split(split.left, split.right, rng)
            case "drop":
                return split.left if rng.random() < 0.5 else split.right
            case "swap":
                return split._replace(left=split.right, right=split.left)
            case _:  # "graft"
                other = nodes_with_paths(others[int(rng.integers(len(others)))])
                return other[int(rng.integers(len(other)))][1]

    def _random_split(self, left: NestedTree, right: NestedTree, rng: np.random.Generator) -> Split:
        feature = self.splittable[int(rng.integers(len(self.splittable)))]
        return Split(feature, self._gap(feature, int(rng.integers(len(self.seen[feature]) - 1))), left, right)

    def _gap(self, feature: int, i: int) -> float:
        """Return the middle between an observed value and the next."""
        low, high = self.seen[feature][i : i + 2].tolist()
        return low + (high - low) / 2

    def _near(self, split: Split, rng: np.random.Generator) -> float:
        values = self.seen[split.feature]
        if len(values) >= FEW:
            step = self.spread[split.feature] * 10 ** rng.uniform(-2.5, 0)
            return split.threshold + float(rng.normal()) * step
        at = int(np.searchsorted(values, split.threshold, side="right")) - 1 + int(rng.choice((-1, 1)))
        return self._gap(split.feature, min(max(at, 0), len(values) - 2))

    def _range(self) -> tuple[Float[np.ndarray, " outputs"], Float[np.ndarray, " outputs"]]:
        """Return the bounds of continuous actions; -1 and 1 where there are none."""
        assert isinstance(self.actions, BoxActions)
        low, high = np.asarray(self.actions.low, float), np.asarray(self.actions.high, float)
        return np.where(np.isfinite(low), low, -1.0), np.where(np.isfinite(high), high, 1.0)


_OF_LEAVES = {"action": 0.16, "grow": 0.1, "grow anywhere": 0.04}
"""Another action; a split in place of a leaf, or above any node, with a new leaf on its other side."""
_OF_SPLITS = {"threshold": 0.4, "split": 0.1, "drop": 0.12, "swap": 0.02, "graft": 0.06}
"""Another threshold, another split, one side in place of both, swapped sides, a subtree of another tree."""
_KINDS = (*_OF_LEAVES, *_OF_SPLITS)
_CUMULATED = np.cumsum([*_OF_LEAVES.values(), *_OF_SPLITS.values()][:-1])


def _sure(n: int, choice: int) -> tuple[float, ...]:
    other = math.log((1 - SURE) / max(n - 1, 1))
    return tuple(math.log(SURE) if i == choice else other for i in range(n))
