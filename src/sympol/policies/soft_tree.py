"""The soft decision tree (SDT): every observation takes every path, each with a weight.

As the paper improves on Silva et al. (2020, arXiv:1903.09338): a node's feature weights are entmax15 of its logits,
so that they are sparse and sum to one, and its gate is the entmoid of how far the weighted observation lies from the
node's threshold. The outputs of the leaves are averaged by the weights of the paths to them.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..functional.entmax import entmax15, entmoid15
from ..functional.random import normals


class SoftTree(eqx.Module):
    """A complete soft tree of depth D over F features: N = 2^D − 1 gates, L = 2^D leaves of A outputs.

    Attributes:
        feature_logits: The logits of each feature at each gate.
        thresholds: The threshold of each gate.
        leaf_values: The outputs of each leaf.
        log_std: One log standard deviation for each continuous action dimension; empty for discrete actions.
        temperature: The temperature of the gates.
    """

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
        """Draw random gates for observations of about unit scale, and leaves near zero.

        Args:
            key: The source of randomness.
            depth: The depth D.
            num_features: The number of features F.
            num_outputs: The number of outputs A.
            num_std: The number of log standard deviations.
            log_std: Their initial value.
            temperature: The temperature of the gates.

        Returns:
            The tree.
        """
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
        """Return the mean of the leaves' outputs, weighted by the paths of each observation."""
        return self.reach(x) @ self.leaf_values

    def reach(self, x: Float[Array, "batch features"]) -> Float[Array, "batch leaves"]:
        """Compute the weight of each observation's path to each leaf.

        Args:
            x: Scaled observations.

        Returns:
            The weights; rows sum to one.
        """
        left = entmoid15((self.thresholds[None] - x @ self.weights.T) / self.temperature)
        reach = jnp.ones((x.shape[0], 1))
        for depth in range(len(self.thresholds).bit_length()):
            gate = left[:, 2**depth - 1 : 2 ** (depth + 1) - 1]
            reach = jnp.stack([reach * gate, reach * (1 - gate)], axis=-1).reshape(x.shape[0], -1)
        return reach

    def rollout(self) -> SoftTree:
        """Return the tree itself: there is nothing to select beforehand.

        Returns:
            The tree.
        """
        return self
