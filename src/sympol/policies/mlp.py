"""The multilayer perceptron, the critic and an actor to compare with."""

from __future__ import annotations

import itertools
import math

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray

from ..functional.random import normals


class MLP(eqx.Module):
    """Dense layers with tanh between them.

    Attributes:
        weights: The weights of each layer.
        biases: The biases of each layer.
    """

    weights: tuple[Float[Array, "inputs outputs"], ...]
    biases: tuple[Float[Array, " outputs"], ...]

    @staticmethod
    def create(key: PRNGKeyArray, sizes: tuple[int, ...]) -> MLP:
        """Draw random layers with a standard deviation of 1/√inputs, that of the last layer a tenth of it.

        Args:
            key: The source of randomness.
            sizes: The numbers of units, inputs first.

        Returns:
            The network.
        """
        shapes = list(itertools.pairwise(sizes))
        scales = [1.0] * (len(shapes) - 1) + [0.1]
        weights = tuple(
            noise * (scale / math.sqrt(shape[0]))
            for noise, shape, scale in zip(normals(key, shapes), shapes, scales, strict=True)
        )
        return MLP(weights, tuple(jnp.zeros(shape[1]) for shape in shapes))

    def __call__(self, x: Float[Array, "batch inputs"]) -> Float[Array, "batch outputs"]:
        """Compute the outputs."""
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = jnp.tanh(x @ weight + bias[None])
        return x @ last[0] + last[1][None]

    def on_scale(self, before: tuple[Array, Array], after: tuple[Array, Array]) -> MLP:
        """Return the network that computes the same of inputs on another scale.

        Args:
            before: The shift and the factor of each input so far.
            after: Those that it is to have, where no factor is 0.

        Returns:
            The network, with another first layer.
        """
        (shift, factor), (new_shift, new_factor) = before, after
        first = self.weights[0]
        bias = self.biases[0] + ((new_shift - shift) * factor) @ first
        return MLP(((factor / new_factor)[:, None] * first, *self.weights[1:]), (bias, *self.biases[1:]))


class MLPActor(eqx.Module):
    """An MLP that acts.

    Attributes:
        net: The network.
        log_std: One log standard deviation for each continuous action dimension.
    """

    net: MLP
    log_std: Float[Array, " num_std"]

    @staticmethod
    def create(
        key: PRNGKeyArray,
        sizes: tuple[int, ...],
        *,
        num_std: int = 0,
        log_std: Float[Array, ""] | float = 0.0,
    ) -> MLPActor:
        """Draw a random network.

        Args:
            key: The source of randomness.
            sizes: The numbers of units, the features first and the outputs last.
            num_std: The number of log standard deviations.
            log_std: Their initial value.

        Returns:
            The actor.
        """
        return MLPActor(MLP.create(key, sizes), jnp.full((num_std,), log_std))

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """Compute the outputs."""
        return self.net(x)

    def rollout(self) -> MLP:
        """Return the network, for acting.

        Returns:
            The network.
        """
        return self.net
