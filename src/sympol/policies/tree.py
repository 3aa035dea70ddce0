"""The tree policy: a hard, axis-aligned decision tree with trainable splits and leaves."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..functional import hard_tree, leaf_index, select
from ..functional.hard_tree import Surrogate
from ..functional.random import normals

MASKED = float(np.finfo(np.float32).max)
"""The threshold of a closed node, which sends everything to one side and has no gradient: the largest float32. Division
by a temperature may turn it into infinity, which has the same effect."""


class RolloutTree(NamedTuple):
    """The same tree with its splits chosen: D comparisons an observation, nothing to differentiate.

    Attributes:
        feature: The feature of each split.
        threshold: The threshold of each split.
        leaf_values: The outputs of each leaf.
    """

    feature: Int[Array, " nodes"]
    threshold: Float[Array, " nodes"]
    leaf_values: Float[Array, "leaves outputs"]

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """Return the outputs of the leaf that each observation reaches."""
        return self.leaf_values[leaf_index(self.feature, self.threshold, x)]


class FixedSplits(NamedTuple):
    """A tree of which only the leaves learn.

    Attributes:
        tree: The tree.
        log_std: The log standard deviations, as of `Tree`.
    """

    tree: RolloutTree
    log_std: Float[Array, " num_std"]

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """Return the outputs of the leaf that each observation reaches."""
        return self.tree(x)


class Tree(eqx.Module):
    """A complete tree of depth D over F features: N = 2^D − 1 splits, L = 2^D leaves of A outputs.

    Attributes:
        feature_logits: The logits of each feature at each split.
        thresholds: A threshold for each feature at each split.
        leaf_values: The outputs of each leaf.
        log_std: One log standard deviation for each continuous action dimension; empty for discrete actions.
        surrogate: The function that replaces the comparison in the backward pass.
        temperature: The temperature of this function.
    """

    feature_logits: Float[Array, "nodes features"]
    thresholds: Float[Array, "nodes features"]
    leaf_values: Float[Array, "leaves outputs"]
    log_std: Float[Array, " num_std"]
    surrogate: Surrogate = eqx.field(static=True)
    temperature: float = eqx.field(static=True)

    @staticmethod
    def create(
        key: PRNGKeyArray,
        *,
        depth: int,
        num_features: int,
        num_outputs: int,
        num_std: int = 0,
        log_std: Float[Array, ""] | float = 0.0,
        threshold_std: Float[Array, ""] | float = 0.5,
        surrogate: Surrogate = "sigmoid",
        temperature: float = 1.0,
    ) -> Tree:
        """Draw random splits for observations of about unit scale, and leaves near zero.

        Args:
            key: The source of randomness.
            depth: The depth D.
            num_features: The number of features F.
            num_outputs: The number of outputs A.
            num_std: The number of log standard deviations.
            log_std: Their initial value.
            threshold_std: The standard deviation of the thresholds.
            surrogate: See the class.
            temperature: See the class.

        Returns:
            The tree.
        """
        nodes = 2**depth - 1
        splits = (nodes, num_features)
        logits, thresholds, leaves = normals(key, [splits, splits, (nodes + 1, num_outputs)])
        return Tree(
            feature_logits=0.1 * logits,
            thresholds=threshold_std * thresholds,
            leaf_values=0.01 * leaves,
            log_std=jnp.full((num_std,), log_std),
            surrogate=surrogate,
            temperature=temperature,
        )

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """Return the outputs of the leaf of each observation, differentiable straight through."""
        return hard_tree(
            self.feature_logits,
            self.thresholds / self.temperature,
            self.leaf_values,
            x / self.temperature,
            surrogate=self.surrogate,
        )

    def rollout(self) -> RolloutTree:
        """Choose the splits, for acting.

        Returns:
            The tree with its splits chosen.
        """
        return RolloutTree(*select(self.feature_logits, self.thresholds), self.leaf_values)
