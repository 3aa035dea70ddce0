"""A soft decision tree as its readers see it: plain numbers with names, for pictures and for text."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..policies.soft_tree import SoftTree
from ..trees import DecisionTree
from ..trees.actions import ActionSpec
from ..trees.floats import printable

MOST_TERMS = 5
"""Features that a node names; of more, the lightest are added up."""


class Term(NamedTuple):
    """A feature, or several that are added up, and its weight in a node.

    Attributes:
        name: The name.
        weight: The weight.
    """

    name: str
    weight: float


@dataclass(frozen=True, eq=False)
class SoftView:
    """A soft tree of N = 2^D − 1 nodes, breadth-first, with the meaning of its numbers.

    The nodes see ``(x − shift) · scale``.

    Attributes:
        actor: The soft tree.
        shift: The shift of each feature.
        scale: The scale of each feature.
        actions: The meaning of the outputs.
        feature_names: The names of the features.
        shares: The part of the weight of some observations that reaches each leaf, if that is known.
    """

    actor: SoftTree
    shift: Float[np.ndarray, " features"]
    scale: Float[np.ndarray, " features"]
    actions: ActionSpec
    feature_names: tuple[str, ...]
    shares: Float[np.ndarray, " leaves"] | None = None

    def __post_init__(self) -> None:
        """Check what a file may have got wrong."""
        if self.shares is not None and np.shape(self.shares) != np.shape(self.leaf_values)[:1]:
            raise ValueError(
                f"shares must be one for each of {len(self.leaf_values)} leaves, got {self.shares}"
            )

    @property
    def thresholds(self) -> Float[np.ndarray, " nodes"]:
        """The thresholds of the weighted sums of scaled features."""
        return np.asarray(self.actor.thresholds)

    @property
    def leaf_values(self) -> Float[np.ndarray, "leaves outputs"]:
        """The logits or means of each leaf."""
        return np.asarray(self.actor.leaf_values)

    @property
    def reach(self) -> float:
        """The distance beyond its threshold at which a gate is closed: entmoid15 is 0 and 1 beyond ∓2."""
        return 2 * self.actor.temperature

    def terms(self, node: int) -> list[Term]:
        """Return the terms that a node adds up.

        Args:
            node: The number of the node.

        Returns:
            The terms, the heaviest first, without features of no weight.
        """
        weights = np.asarray(self.actor.weights[node], np.float64)
        order = [int(i) for i in np.argsort(-weights, kind="stable") if weights[i] > 0]
        if len(order) <= MOST_TERMS:
            named, rest = order, []
        else:
            named, rest = order[: MOST_TERMS - 1], order[MOST_TERMS - 1 :]
        terms = [Term(printable(self.feature_names[i]), float(weights[i])) for i in named]
        return terms + ([Term(f"{len(rest)} others", float(weights[rest].sum()))] if rest else [])

    def scaling(self) -> list[str]:
        """Describe the scaling of the features that some node compares.

        Returns:
            A text for each feature that is scaled.
        """
        used = np.flatnonzero((np.asarray(self.actor.weights) > 0).any(axis=0))
        scaled = [i for i in used.tolist() if (self.shift[i], self.scale[i]) != (0, 1)]
        return [
            f"{printable(self.feature_names[i])}: {_affine(self.shift[i], self.scale[i])}" for i in scaled
        ]

    def with_shares_of(self, x: Float[np.ndarray, "batch features"]) -> SoftView:
        """Compute the shares of the leaves from observations.

        Args:
            x: Raw observations.

        Returns:
            The same view, with these shares.
        """
        scaled = (np.asarray(x, np.float32) - self.shift) * self.scale
        return replace(self, shares=np.asarray(self.actor.reach(jnp.asarray(scaled)).mean(axis=0)))

    def skeleton(self) -> DecisionTree:
        """Return a hard tree of the same form, to be laid out.

        Returns:
            The tree; its nodes are `in_preorder` of this one.
        """
        tree = DecisionTree.from_complete(
            np.asarray(self.actor.weights).argmax(axis=1),
            self.thresholds,
            self.leaf_values,
            actions=self.actions,
            feature_names=self.feature_names,
        )
        if self.shares is None:
            return tree
        levels = [np.round(1e6 * np.asarray(self.shares, np.float64)).astype(np.int64)]
        while len(levels[0]) > 1:
            levels.insert(0, levels[0].reshape(-1, 2).sum(axis=1))
        return replace(tree, n_node_samples=np.concatenate(levels)[in_preorder(len(self.thresholds))])


def in_preorder(n_inner: int) -> list[int]:
    """Return the nodes of a complete tree in preorder.

    Args:
        n_inner: The number of inner nodes.

    Returns:
        The nodes, numbered breadth-first.
    """
    order, awaited = [], [0]
    while awaited:
        order.append(node := awaited.pop())
        if node < n_inner:
            awaited += [2 * node + 2, 2 * node + 1]
    return order


def _affine(shift: float, scale: float) -> str:
    if shift == 0:
        return f"x · {scale:.3g}"
    return f"(x {'−' if shift > 0 else '+'} {abs(shift):.3g}) · {scale:.3g}"


def percent(share: float) -> str:
    """Format a share: ``62 %``, ``<1 %``, ``>99 %``.

    Args:
        share: The share, from 0 to 1.

    Returns:
        The text.
    """
    if 0 < share < 0.005:
        return "<1 %"
    return ">99 %" if 0.995 <= share < 1 else f"{share:.0%}".replace("%", " %")
