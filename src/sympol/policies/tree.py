"""The tree policy: a hard, axis-aligned decision tree with trainable splits and leaves."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, Int, PRNGKeyArray

from ..functional import hard_tree, leaf_index, select
from ..functional.hard_tree import Surrogate
from ..functional.random import normals


class RolloutTree(NamedTuple):
    """The same tree with its splits chosen: D comparisons an observation, nothing to differentiate."""

    feature: Int[Array, " nodes"]
    threshold: Float[Array, " nodes"]
    leaf_values: Float[Array, "leaves outputs"]

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """The outputs of the leaf that each observation falls into."""
        return self.leaf_values[leaf_index(self.feature, self.threshold, x)]


class Tree(eqx.Module):
    """A complete tree of depth D over F features: N = 2^D − 1 splits, L = 2^D leaves of A outputs.

    ``log_std`` has one entry per continuous action dimension and is empty otherwise.
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
        """Random splits over observations of about unit scale; leaves near zero, so near indifference."""
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
        """The outputs of the leaf of each observation, differentiable straight through."""
        return hard_tree(
            self.feature_logits,
            self.thresholds / self.temperature,
            self.leaf_values,
            x / self.temperature,
            surrogate=self.surrogate,
        )

    def rollout(self) -> RolloutTree:
        """The tree as it acts."""
        return RolloutTree(*select(self.feature_logits, self.thresholds), self.leaf_values)
