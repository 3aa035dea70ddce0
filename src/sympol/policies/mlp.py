"""The critic: a multilayer perceptron."""

from __future__ import annotations

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float, PRNGKeyArray


class MLP(eqx.Module):
    """Dense layers with tanh between them; ``weights[i]`` is ``[in, out]``."""

    weights: tuple[Float[Array, "inputs outputs"], ...]
    biases: tuple[Float[Array, " outputs"], ...]

    @staticmethod
    def create(key: PRNGKeyArray, sizes: tuple[int, ...]) -> MLP:
        """Layers of the sizes given, inputs first; variance 1/inputs, the last layer a tenth of that."""
        keys = jax.random.split(key, len(sizes) - 1)
        shapes = list(itertools.pairwise(sizes))
        scales = [1.0] * (len(shapes) - 1) + [0.1]
        weights = tuple(
            scale * jax.random.normal(k, shape) / jnp.sqrt(jnp.float32(shape[0]))
            for k, shape, scale in zip(keys, shapes, scales, strict=True)
        )
        return MLP(weights, tuple(jnp.zeros(shape[1]) for shape in shapes))

    def __call__(self, x: Float[Array, "batch inputs"]) -> Float[Array, "batch outputs"]:
        """Forward."""
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = jnp.tanh(x @ weight + bias[None])
        return x @ last[0] + last[1][None]
