"""The soft decision tree (SDT): every observation takes every way, each with a weight.

As the paper improves on Silva et al. (2020, arXiv:1903.09338): a node's feature weights are entmax15 of its logits,
so that they are sparse and sum to one, and its gate is the entmoid of how far the weighted observation lies from the
node's threshold. The outputs of the leaves are averaged by the weights of the ways to them.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..functional.entmax import entmax15, entmoid15
from ..functional.random import normals


class SoftTree(eqx.Module):
    """A complete soft tree of depth D over F features: N = 2^D − 1 gates, L = 2^D leaves of A outputs."""

    feature_logits: Float[Array, "nodes features"]
    thresholds: Float[Array, " nodes"]
    leaf_values: Float[Array, "leaves outputs"]
    log_std: Float[Array, " num_std"]
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
        temperature: float = 1.0,
    ) -> SoftTree:
        """Random gates over observations of about unit scale; leaves near zero, so near indifference."""
        nodes = 2**depth - 1
        logits, thresholds, leaves = normals(key, [(nodes, num_features), (nodes,), (nodes + 1, num_outputs)])
        return SoftTree(
            feature_logits=logits,
            thresholds=0.1 * thresholds,
            leaf_values=0.1 * leaves,
            log_std=jnp.full((num_std,), log_std),
            temperature=temperature,
        )

    @property
    def weights(self) -> Float[Array, "nodes features"]:
        """Return the weight of each feature in each node; rows sum to one."""
        return entmax15(self.feature_logits)

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """The mean of the leaves' outputs, weighted by the ways of each observation."""
        return self.reach(x) @ self.leaf_values

    def reach(self, x: Float[Array, "batch features"]) -> Float[Array, "batch leaves"]:
        """The weight of each observation's way to each leaf; rows sum to one."""
        left = entmoid15((self.thresholds[None] - x @ self.weights.T) / self.temperature)
        reach = jnp.ones((x.shape[0], 1))
        for depth in range(len(self.thresholds).bit_length()):
            gate = left[:, 2**depth - 1 : 2 ** (depth + 1) - 1]
            reach = jnp.stack([reach * gate, reach * (1 - gate)], axis=-1).reshape(x.shape[0], -1)
        return reach

    def rollout(self) -> SoftTree:
        """Return the tree itself: there is nothing to select beforehand."""
        return self
