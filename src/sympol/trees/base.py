"""The data of a decision tree: its arrays, their validation, and what they say about observations.

A tree is a struct of arrays under scikit-learn's names, one row per node, in preorder: the root is node 0, the
left child of node i is i + 1, and every subtree is one contiguous slice.

Everything else in `sympol.trees` is a function of a `BaseTree`. `DecisionTree` stands on top and offers these
functions as methods.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

import numpy as np

from .actions import ActionSpec, DiscreteActions, MultiDiscreteActions
from .floats import brief, flushed, observation_batch
from .groups import Group, check_groups, check_integers, require_one_hot
from .preorder import (
    NO_CHILD,
    NO_FEATURE,
    NO_THRESHOLD,
    complete_to_preorder,
    depths,
    descend,
    descend_one,
    paths,
    visits,
)

if TYPE_CHECKING:
    from jaxtyping import Bool, Float, Float32, Int, Int32, Int64
    from numpy.typing import ArrayLike

LONGEST_NAME = 10_000
"""Most characters in the name of a feature, an action, a group or a category."""
MOST_WORDS = 200_000_000
"""Most characters of all names together, each counted as often as a node mentions it."""


@dataclass(frozen=True, eq=False, repr=False)
class BaseTree:
    """The data of a hard, axis-aligned decision tree. Users meet it as `DecisionTree`.

    An observation is rounded to float32 and its subnormal numbers count as zero. At an inner node
    ``x[feature] <= threshold`` goes left, everything else, NaN included, goes right. This holds to the bit in
    training and in every export.

    The arrays are copied and read-only. Two trees are equal when all of their fields are, bit for bit.

    Args:
        children_left: The left child of each node, [nodes]; -1 at leaves.
        children_right: The right child of each node, [nodes]; -1 at leaves.
        feature: The feature each inner node compares, [nodes]; -2 at leaves.
        threshold: What it is compared with, [nodes]; -2.0 at leaves.
        value: What each leaf outputs, [nodes, outputs]; zero at inner nodes. Read it through `leaf_outputs`.
        actions: The meaning of the outputs: logits, or the mean of a continuous action.
        feature_names: The name of each number in an observation.
        feature_low: The lower bounds of the observation space, [features]; -inf for none.
        feature_high: The upper bounds, [features]; inf for none.
        groups: Features that are one-hot together; an observation in which they are not is refused.
        integers: Positions of other features that are whole numbers. Only proofs (`verify`) rely on them.
        n_node_samples: How many observations reached each node, [nodes], if that is known.
        meta: Plain JSON that should stay with the tree, such as the environment's id or the run.

    Raises:
        ValueError: If the arrays are not one tree in preorder, or a number is not finite.
    """

    children_left: Int32[np.ndarray, " nodes"]
    children_right: Int32[np.ndarray, " nodes"]
    feature: Int32[np.ndarray, " nodes"]
    threshold: Float32[np.ndarray, " nodes"]
    value: Float32[np.ndarray, "nodes outputs"]
    actions: ActionSpec
    feature_names: tuple[str, ...]
    feature_low: Float32[np.ndarray, " features"]
    feature_high: Float32[np.ndarray, " features"]
    groups: tuple[Group, ...] = ()
    integers: tuple[int, ...] = ()
    n_node_samples: Int64[np.ndarray, " nodes"] | None = None
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Copy, round and check."""
        arrays: dict[str, np.ndarray] = {}
        for name in ("children_left", "children_right", "feature"):
            arrays[name] = np.array(getattr(self, name), np.int32)
        for name in ("threshold", "value", "feature_low", "feature_high"):
            arrays[name] = flushed(getattr(self, name))
        if self.n_node_samples is not None:
            arrays["n_node_samples"] = np.array(self.n_node_samples, np.int64)
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "feature_names", tuple(self.feature_names))
        object.__setattr__(self, "groups", check_groups(self.groups, len(self.feature_names)))
        object.__setattr__(
            self, "integers", check_integers(self.integers, self.groups, len(self.feature_names))
        )
        # through JSON and back: a copy nobody else holds, and proof that it can be written
        object.__setattr__(self, "meta", json.loads(json.dumps(dict(self.meta), allow_nan=False)))
        _check(self)

    @classmethod
    def from_complete(
        cls,
        feature: Int[np.ndarray, " inner"],
        threshold: Float[np.ndarray, " inner"],
        leaf_values: Float[np.ndarray, "leaves outputs"],
        *,
        actions: ActionSpec,
        feature_names: Sequence[str] | None = None,
        feature_low: ArrayLike | None = None,
        feature_high: ArrayLike | None = None,
        groups: Sequence[Group] = (),
        integers: Sequence[int] = (),
        meta: Mapping[str, Any] | None = None,
    ) -> Self:
        """Build a tree from a complete one in breadth-first order, as it is trained.

        The children of inner node n are 2n + 1 and 2n + 2, leaf l is node N + l, and N = 2^depth − 1.

        Args:
            feature: The feature each inner node compares, [N].
            threshold: What it is compared with, [N].
            leaf_values: The outputs of each leaf, [N + 1, outputs].
            actions: The meaning of the outputs.
            feature_names: The name of each number in an observation. By default ``x[0]``, ``x[1]``, … up to the
                last feature that a node compares or that has a bound.
            feature_low: Lower bounds of the observations, [features]; none by default.
            feature_high: Upper bounds of the observations, [features]; none by default.
            groups: Features that are one-hot together.
            integers: Positions of other features that are whole numbers.
            meta: Plain JSON that should stay with the tree.

        Returns:
            The tree, its nodes in preorder.

        Raises:
            ValueError: If the shapes are not those of a complete tree, or a number is not finite.
        """
        feature, threshold = np.asarray(feature), np.asarray(threshold)
        if feature_names is None:
            bounds = feature_low if feature_low is not None else feature_high
            n_features = int(feature.max(initial=-1)) + 1 if bounds is None else np.size(bounds)
            feature_names = [f"x[{i}]" for i in range(n_features)]
        n_features = len(feature_names)
        return cls(
            **complete_to_preorder(feature, threshold, np.asarray(leaf_values)),
            actions=actions,
            feature_names=tuple(feature_names),
            feature_low=np.full(n_features, -np.inf) if feature_low is None else np.asarray(feature_low),
            feature_high=np.full(n_features, np.inf) if feature_high is None else np.asarray(feature_high),
            groups=tuple(groups),
            integers=tuple(integers),
            meta=meta or {},
        )

    @property
    def n_nodes(self) -> int:
        """The number of inner nodes and leaves."""
        return len(self.feature)

    @property
    def n_leaves(self) -> int:
        """The number of leaves."""
        return int(np.count_nonzero(self.is_leaf))

    @property
    def n_features(self) -> int:
        """The number of features in an observation."""
        return len(self.feature_names)

    @cached_property
    def is_leaf(self) -> Bool[np.ndarray, " nodes"]:
        """True for each node that is a leaf, [nodes]."""
        leaf = self.children_left == NO_CHILD
        leaf.setflags(write=False)
        return leaf

    @cached_property
    def group_of(self) -> Mapping[int, Group]:
        """The group of each feature that belongs to one."""
        return {feature: group for group in self.groups for feature in group.features}

    @property
    def node_depth(self) -> Int[np.ndarray, " nodes"]:
        """The number of comparisons above each node, [nodes]."""
        return depths(self.children_left, self.children_right)

    @property
    def depth(self) -> int:
        """The largest number of comparisons before a leaf."""
        return int(self.node_depth.max())

    @property
    def leaf_outputs(self) -> Float32[np.ndarray, "nodes outputs"]:
        """The constant each leaf outputs, [nodes, outputs]; rows of inner nodes are zero.

        For code that rewrites leaves or reads them without an observation. With observations, call `outputs`.
        """
        return self.value

    @cached_property
    def leaf_actions(self) -> np.ndarray:
        """The deterministic action of each leaf, [nodes, *action]; rows of inner nodes mean nothing."""
        decided = self.actions.decide(self.leaf_outputs)
        decided.setflags(write=False)
        return decided

    def apply(self, X: ArrayLike) -> Int32[np.ndarray, "*batch"] | np.int32:
        """Return the leaf that each observation reaches.

        Args:
            X: One observation [features], or many [batch, features].

        Returns:
            The number of the leaf, or one for each observation, [batch].

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers.
        """
        x, single = observation_batch(X, self.n_features)
        require_one_hot(self.groups, x)
        if single:
            return np.int32(descend_one(*self._lists, x[0].tolist()))
        return descend(self.children_left, self.children_right, self.feature, self.threshold, x)

    def outputs(self, X: ArrayLike) -> Float32[np.ndarray, "*batch outputs"]:
        """Return what the tree outputs for each observation: the numbers that `actions` gives a meaning.

        Args:
            X: One observation [features], or many [batch, features].

        Returns:
            Logits, or the mean of a continuous action before it is clipped: [outputs], or [batch, outputs].

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers.
        """
        return self.value[self.apply(X)]

    def predict(self, X: ArrayLike) -> np.ndarray:
        """Return the deterministic action for each observation.

        Args:
            X: One observation [features], or many [batch, features].

        Returns:
            One action, or one for each observation, [batch, *action].

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers.
        """
        outputs = self.outputs(X)
        decided = self.actions.decide(np.atleast_2d(outputs))
        return decided[0] if outputs.ndim == 1 else decided

    def predict_proba(self, X: ArrayLike) -> np.ndarray | tuple[np.ndarray, ...]:
        """Return the probability of every discrete action for each observation.

        Args:
            X: One observation [features], or many [batch, features].

        Returns:
            Probabilities [actions], or [batch, actions]; a tuple of such arrays where actions have several components.

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers, or actions are continuous: these have a density instead.
        """
        outputs = self.outputs(X)
        chances = self.actions.probabilities(np.atleast_2d(outputs))
        if outputs.ndim > 1:
            return chances
        return tuple(chance[0] for chance in chances) if isinstance(chances, tuple) else chances[0]

    def decision_path(self, X: ArrayLike) -> Bool[np.ndarray, "*batch nodes"]:
        """Return which nodes each observation passes, the leaf included.

        Args:
            X: One observation [features], or many [batch, features].

        Returns:
            A dense array of booleans: [nodes], or [batch, nodes].

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers.
        """
        leaf = self.apply(X)
        on_path = paths(self.children_left, self.children_right, np.atleast_1d(leaf))
        return on_path[0] if np.ndim(leaf) == 0 else on_path

    def with_visits(self, X: ArrayLike) -> Self:
        """Return this tree with ``n_node_samples`` counted on observations.

        Args:
            X: The observations to count, [batch, features].

        Returns:
            A copy that differs in ``n_node_samples`` only.

        Raises:
            ValueError: If X has another shape, or a group of features is not one-hot.
            TypeError: If X does not hold numbers.
        """
        leaf = np.atleast_1d(self.apply(X))
        return replace(self, n_node_samples=visits(self.children_left, self.children_right, leaf))

    def __getstate__(self) -> dict[str, Any]:
        """Return what is pickled and copied: the fields, and nothing that is derived from them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Build the tree again, checked and read-only: a pickle or a deep copy makes arrays writable."""
        self.__init__(**{field.name: state[field.name] for field in fields(self)})

    def __repr__(self) -> str:
        """Summarize the size of the tree."""
        return (
            f"<{type(self).__name__}: {self.n_nodes} nodes, {self.n_leaves} leaves, depth {self.depth}, "
            f"{self.n_features} features, {type(self.actions).__name__}>"
        )

    def _content(self) -> tuple[object, ...]:
        values = [getattr(self, field.name) for field in fields(self) if field.name != "meta"]
        plain = (value.tobytes() if isinstance(value, np.ndarray) else value for value in values)
        return (*plain, json.dumps(self.meta, sort_keys=True))

    def __eq__(self, other: object) -> bool:
        """Return whether two trees have the same fields, bit for bit."""
        if not isinstance(other, BaseTree):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        """Agree with ``==``."""
        return hash(self._content())

    @cached_property
    def _lists(self) -> tuple[list[int], list[int], list[int], list[float]]:
        links = self.children_left.tolist(), self.children_right.tolist()
        return *links, self.feature.tolist(), self.threshold.tolist()


TreeT = TypeVar("TreeT", bound=BaseTree)
"""The type of a tree that a function takes and returns."""


def _check(tree: BaseTree) -> None:
    """Raise ValueError unless the arrays are one tree in preorder over the features and actions it names."""
    n_nodes, n_features, n_outputs = tree.n_nodes, tree.n_features, tree.actions.n_outputs
    shapes = {"children_left": n_nodes, "children_right": n_nodes, "feature": n_nodes, "threshold": n_nodes}
    shapes |= {"feature_low": n_features, "feature_high": n_features}
    shapes |= {} if tree.n_node_samples is None else {"n_node_samples": n_nodes}
    for name, length in shapes.items():
        if getattr(tree, name).shape != (length,):
            raise ValueError(f"{name} must have shape ({length},), got {getattr(tree, name).shape}")
    if n_nodes == 0 or tree.value.shape != (n_nodes, n_outputs):
        raise ValueError(f"value must have shape ({max(n_nodes, 1)}, {n_outputs}), got {tree.value.shape}")
    if not all(isinstance(name, str) for name in tree.feature_names):
        raise ValueError(f"feature_names must be strings, got {tree.feature_names!r}")
    for name in ("threshold", "value"):
        if not np.isfinite(array := getattr(tree, name)).all():
            raise ValueError(f"{name} must be finite in float32, got {array[~np.isfinite(array)][0]}")
    if not (tree.feature_low <= tree.feature_high).all():
        worst = int(np.argmin(tree.feature_low <= tree.feature_high))
        raise ValueError(
            f"feature_low must not exceed feature_high, got {tree.feature_low[worst]} and "
            f"{tree.feature_high[worst]} for {tree.feature_names[worst]!r}; use -inf and inf for no bound"
        )
    _check_preorder(tree)
    _check_lengths(tree)
    leaf = tree.is_leaf
    if (tree.feature[leaf] != NO_FEATURE).any() or (tree.threshold[leaf] != NO_THRESHOLD).any():
        raise ValueError(f"leaves must have feature {NO_FEATURE} and threshold {NO_THRESHOLD}")
    if tree.value[~leaf].any():
        raise ValueError("value must be zero at inner nodes: only leaves answer")
    looked_at = tree.feature[~leaf]
    if ((looked_at < 0) | (looked_at >= n_features)).any():
        raise ValueError(
            f"feature must be in [0, {n_features}) at inner nodes, got {sorted(set(looked_at.tolist()))}"
        )
    if (visits := tree.n_node_samples) is not None:
        below = visits[tree.children_left[~leaf]] + visits[tree.children_right[~leaf]]
        if (visits < 0).any() or (visits[~leaf] != below).any():
            raise ValueError("n_node_samples must not be negative, and an inner node's is its children's sum")


def _check_lengths(tree: BaseTree) -> None:
    """Raise ValueError where names are so long that they would fill the memory when every node is written."""
    names = _lengths(tree.feature_names, tree.groups, tree.actions)
    if len(names.longest) > LONGEST_NAME:
        raise ValueError(
            f"a name has at most {LONGEST_NAME:,} characters, got one of {len(names.longest):,}: {brief(names.longest)}"
        )
    looked_at = tree.feature[~tree.is_leaf]
    known = looked_at[(looked_at >= 0) & (looked_at < tree.n_features)]
    if (written := int(names.asked[known].sum()) + tree.n_leaves * names.answer) > MOST_WORDS:
        raise ValueError(
            f"the names of features and actions would be written {written:,} characters long in a tree of "
            f"{tree.n_nodes:,} nodes, more than {MOST_WORDS:,}: give shorter names"
        )


class _Lengths(NamedTuple):
    """How long names are."""

    longest: str
    asked: Int[np.ndarray, " features"]
    """What a question about each feature names."""
    answer: int
    """What an answer names, at most."""


@lru_cache(maxsize=16)
def _lengths(features: tuple[str, ...], groups: tuple[Group, ...], actions: ActionSpec) -> _Lengths:
    """Measure; many trees, one after the other, are of the same features and actions."""
    asked = np.array([len(name) for name in features], np.int64)
    for group in groups:
        asked[list(group.features)] = [len(group.name) + len(category) for category in group.categories]
    options = actions.options if isinstance(actions, MultiDiscreteActions) else ()
    if isinstance(actions, DiscreteActions):
        answer = max(map(len, actions.names))
    else:
        answer = sum(map(len, actions.names)) + sum(max(map(len, names)) for names in options)
    in_groups = [name for group in groups for name in (group.name, *group.categories)]
    every = (*features, *in_groups, *actions.names, *(name for names in options for name in names))
    return _Lengths(max(every, key=len, default=""), asked, answer)


def _check_preorder(tree: BaseTree) -> None:
    """Raise ValueError unless each node but the root is the child of one before it, left subtree first."""
    right_children: list[int] = []
    links = zip(tree.children_left.tolist(), tree.children_right.tolist(), strict=True)
    for node, (left, right) in enumerate(links):
        follows = left
        if left == right == NO_CHILD:
            follows = right_children.pop() if right_children else tree.n_nodes
        else:
            right_children.append(right)
        if follows != node + 1:
            raise ValueError(
                f"nodes must be in preorder, left subtree first: after node {node} comes {follows}"
            )
    if right_children:
        raise ValueError(
            f"nodes must be in preorder, left subtree first: node {right_children[-1]} is missing"
        )
