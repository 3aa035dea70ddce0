"""The decision tree: what every learner hands over and every reader takes.

A tree is a struct of arrays under scikit-learn's names, one row a node, in preorder: the root is node 0, the
left child of node i is i + 1, and every subtree is one contiguous slice.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from .actions import ActionSpec
from .floats import flushed, observation_batch
from .groups import Group, check_groups, check_integers, require_one_hot
from .preorder import NO_CHILD, check, complete_to_preorder
from .traversal import depths, descend, descend_one, paths, visits

if TYPE_CHECKING:
    from os import PathLike

    from jaxtyping import Bool, Float, Float32, Int, Int32, Int64
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

    from .counterfactual import Norm
    from .explain import Explanation
    from .verify.properties import PropertyLike, Verdict


@final
@dataclass(frozen=True, eq=False, repr=False)
class DecisionTree:
    """A hard, axis-aligned decision tree that answers observations with actions.

    An observation is rounded to float32 and its subnormal numbers count as zero. At an inner node
    ``x[feature] <= threshold`` goes left, everything else, NaN included, goes right. This holds to the bit in
    training and in every export.

    The arrays are read-only copies. At leaves the children are -1, ``feature`` is -2 and ``threshold`` is
    -2.0; at inner nodes ``value`` is zero. ``actions`` says what the numbers in ``value`` mean.
    ``feature_low`` and ``feature_high`` are the bounds of the observation space, infinite where it has none.
    ``groups`` says which features are one-hot together; an observation in which they are not is refused.
    ``integers`` are the positions of other features that are whole numbers; only proofs (`verify`) build on it.
    ``n_node_samples`` counts how many observations came by each node, if that is known. ``meta`` is plain
    JSON for whatever else should stay with the tree (the environment's id, the run).

    Two trees are equal when all of this is equal, bit for bit.

    Raises:
        ValueError: if the arrays do not describe a tree in preorder, or a number is not finite.
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
        check(self)

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
    ) -> DecisionTree:
        """Make a tree from a complete one in breadth-first order, as it is trained.

        The children of inner node n are 2n + 1 and 2n + 2, leaf l is node N + l, and N = 2^depth − 1. Without
        names, features are called ``x[0]``, ``x[1]``, … up to the last one that a node looks at or that has
        a bound; without bounds, they have none.
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
        """Inner nodes and leaves."""
        return len(self.feature)

    @property
    def n_leaves(self) -> int:
        """Nodes that answer."""
        return int(np.count_nonzero(self.is_leaf))

    @property
    def n_features(self) -> int:
        """Numbers in an observation."""
        return len(self.feature_names)

    @cached_property
    def is_leaf(self) -> Bool[np.ndarray, " nodes"]:
        """Whether each node is a leaf."""
        leaf = self.children_left == NO_CHILD
        leaf.setflags(write=False)
        return leaf

    @cached_property
    def group_of(self) -> Mapping[int, Group]:
        """The group of each feature that is in one."""
        return {feature: group for group in self.groups for feature in group.features}

    @property
    def node_depth(self) -> Int[np.ndarray, " nodes"]:
        """Comparisons above each node."""
        return depths(self.children_left, self.children_right)

    @property
    def depth(self) -> int:
        """Most comparisons before an answer."""
        return int(self.node_depth.max())

    def apply(self, X: ArrayLike) -> Int32[np.ndarray, "*batch"] | np.int32:
        """Return the leaf of one observation [features], or of each of many [batch, features].

        Raises:
            ValueError: if X has another shape, or a group of features is not one-hot.
            TypeError: if X does not hold numbers.
        """
        x, single = observation_batch(X, self.n_features)
        require_one_hot(self.groups, x)
        if single:
            return np.int32(descend_one(*self._lists, x[0].tolist()))
        return descend(self.children_left, self.children_right, self.feature, self.threshold, x)

    def predict(self, X: ArrayLike) -> np.ndarray:
        """Return the deterministic action of one observation [features], or of many [batch, features].

        Raises:
            ValueError, TypeError: as `apply` does.
        """
        leaf = self.apply(X)
        chosen = self.actions.decide(self.value[np.atleast_1d(leaf)])
        return chosen[0] if np.ndim(leaf) == 0 else chosen

    def predict_proba(self, X: ArrayLike) -> np.ndarray | tuple[np.ndarray, ...]:
        """Return the probability of every action; with several components, a tuple of such arrays.

        Raises:
            TypeError: if actions are continuous: they have a density, not a table of probabilities.
        """
        leaf = self.apply(X)
        chances = self.actions.probabilities(self.value[np.atleast_1d(leaf)])
        if np.ndim(leaf):
            return chances
        return tuple(chance[0] for chance in chances) if isinstance(chances, tuple) else chances[0]

    def decision_path(self, X: ArrayLike) -> Bool[np.ndarray, "*batch nodes"]:
        """Return which nodes each observation comes by: a dense array, batch × nodes booleans."""
        leaf = self.apply(X)
        on_path = paths(self.children_left, self.children_right, np.atleast_1d(leaf))
        return on_path[0] if np.ndim(leaf) == 0 else on_path

    def with_visits(self, X: ArrayLike) -> DecisionTree:
        """Return this tree with ``n_node_samples`` counted on the observations X [batch, features]."""
        leaf = np.atleast_1d(self.apply(X))
        return replace(self, n_node_samples=visits(self.children_left, self.children_right, leaf))

    def prune(
        self, *, bounds: bool = True, merge: bool = True, observations: ArrayLike | None = None
    ) -> DecisionTree:
        """Return the smaller tree that acts the same, knowing bounds and groups: see `sympol.trees.prune`.

        ``observations`` [batch, features] are all there can be, where they can be listed: then it acts the same
        on these, and may act differently on others (`sympol.trees.prune_on`).
        """
        from .prune import prune
        from .prune_on import prune_on

        small = prune(self, bounds=bounds, merge=merge)
        return small if observations is None else prune_on(small, observations, merge=merge)

    def verify(self, *properties: PropertyLike) -> tuple[Verdict, ...]:
        """Prove rules such as ``"when pole angle > 0.1 then action is push right"``: see `sympol.trees.verify`.

        Each is a rule, a `sympol.trees.verify.Property`, or the path of a file of properties.
        """
        from .verify import verify

        return verify(self, properties)

    def explain(
        self,
        observation: ArrayLike,
        *,
        immutable: Iterable[str | int] = (),
        norm: Norm = "l1",
        scale: Mapping[str | int, float] | None = None,
    ) -> Explanation:
        """Say why it acts as it does in one observation, and what else would be needed: see `sympol.trees.explain`."""
        from .explain import explain

        return explain(self, observation, immutable=immutable, norm=norm, scale=scale)

    def to_text(self, *, digits: int | None = None) -> str:
        """Write the tree for people: see `sympol.trees.text`."""
        from .text import to_text

        return to_text(self, digits=digits)

    def rules(self, *, digits: int | None = None) -> list[str]:
        """Write one sentence a leaf: see `sympol.trees.text`."""
        from .text import rules

        return rules(self, digits=digits)

    def plot(
        self,
        path: str | PathLike[str] | None = None,
        *,
        ax: Axes | None = None,
        digits: int = 4,
        highlight: ArrayLike | None = None,
    ) -> Figure:
        """Draw the tree, and save it as SVG, PDF or PNG: see `sympol.trees.plot`."""
        from .plot import plot

        return plot(self, path, ax=ax, digits=digits, highlight=highlight)

    def to_json(self) -> str:
        """Write the tree as strict JSON: see `sympol.trees.serialize`."""
        from .serialize import to_json

        return to_json(self)

    @classmethod
    def from_json(cls, text: str) -> DecisionTree:
        """Read a tree that `to_json` wrote: see `sympol.trees.serialize`."""
        from .serialize import from_json

        return from_json(text)

    @classmethod
    def from_text(
        cls, text: str, *, like: DecisionTree | None = None, actions: ActionSpec | None = None, **space: Any
    ) -> DecisionTree:
        """Read a tree that `to_text` wrote, or somebody by hand: see `sympol.trees.read_text`."""
        from .read_text import from_text

        return from_text(text, like=like, actions=actions, **space)

    def to_html(self) -> str:
        """Write a web page to see, ask and fold the tree: see `sympol.trees.report`."""
        from .report import to_html

        return to_html(self)

    def export(self, to: str, **options: Any) -> str | bytes:
        """Write the tree in one of the formats of `sympol.trees.export.FORMATS`: ``"python"``, ``"c"``, …."""
        from .export import format_of

        return format_of(to).write(self, **options)

    def to_python(self) -> str:
        """Write a Python program without dependencies: see `sympol.trees.export.python`."""
        from .export.python import to_python

        return to_python(self)

    @classmethod
    def from_sklearn(
        cls,
        estimator: DecisionTreeClassifier | DecisionTreeRegressor,
        actions: ActionSpec,
        *,
        feature_names: Sequence[str] | None = None,
        **space: Any,
    ) -> DecisionTree:
        """Make our tree of a fitted one of scikit-learn's: see `sympol.trees.from_sklearn`."""
        from .from_sklearn import from_sklearn

        return from_sklearn(estimator, actions, feature_names=feature_names, **space)

    def to_sklearn(self, *, names: bool = True) -> DecisionTreeClassifier | DecisionTreeRegressor:
        """Make a fitted scikit-learn estimator: see `sympol.trees.export.sklearn`."""
        from .export.sklearn import to_sklearn

        return to_sklearn(self, names=names)

    def __getstate__(self) -> dict[str, Any]:
        """What is pickled and copied: the fields, and nothing that follows from them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        """Make the tree anew, checked and read-only: arrays come out of a pickle, or a deep copy, writable."""
        self.__init__(**{field.name: state[field.name] for field in fields(self)})

    def __str__(self) -> str:
        """Write the tree for people."""
        return self.to_text()

    def __repr__(self) -> str:
        """Say how large it is."""
        return (
            f"<DecisionTree: {self.n_nodes} nodes, {self.n_leaves} leaves, depth {self.depth}, "
            f"{self.n_features} features, {type(self.actions).__name__}>"
        )

    def _content(self) -> tuple[object, ...]:
        values = [getattr(self, field.name) for field in fields(self) if field.name != "meta"]
        plain = (value.tobytes() if isinstance(value, np.ndarray) else value for value in values)
        return (*plain, json.dumps(self.meta, sort_keys=True))

    def __eq__(self, other: object) -> bool:
        """Whether two trees hold the same, bit for bit."""
        if not isinstance(other, DecisionTree):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        """Agree with ``==``."""
        return hash(self._content())

    @cached_property
    def _lists(self) -> tuple[list[int], list[int], list[int], list[float]]:
        links = self.children_left.tolist(), self.children_right.tolist()
        return *links, self.feature.tolist(), self.threshold.tolist()
