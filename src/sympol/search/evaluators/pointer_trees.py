"""Large trees side by side in a compiled program, walked down by their links."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Float32, Int
from numpy import ndarray

from .stacked_trees import Packed


class Linked(NamedTuple):
    """`Packed` with one row a node of any tree, as gathers like it; the work grows with the depth alone."""

    feature: Int[ndarray, " rows"]
    threshold: Float32[ndarray, " rows"]
    children: Int[ndarray, " rows*2"]
    """Of each row the left one and the right one, as rows."""
    value: Float32[ndarray, "trees nodes outputs"]
    depth: Int[ndarray, ""]

    @staticmethod
    def of(packed: Packed) -> Linked:
        """Lay them out."""
        first = np.arange(packed.feature.size, step=packed.feature.shape[1], dtype=np.int32)[:, None, None]
        children = np.stack([packed.left, packed.right], axis=-1) + first
        flat = packed.feature.ravel(), packed.threshold.ravel(), children.ravel()
        return Linked(*flat, packed.value, packed.depth)

    def held(self, tree: Int[Array, " lanes"]) -> tuple[Array, ...]:
        """Nothing that a lane would have to keep of its tree."""
        return ()

    def apply(
        self, tree: Int[Array, " lanes"], held: tuple[Array, ...], x: Float[Array, "lanes features"]
    ) -> Int[Array, " lanes"]:
        """Which of its nodes each lane's tree ends in."""
        numbers, first = x.ravel(), jnp.arange(len(x)) * x.shape[1]

        def down(_: Int[Array, ""], row: Int[Array, " lanes"]) -> Int[Array, " lanes"]:
            goes_left = _at(numbers, first + _at(self.feature, row)) <= _at(self.threshold, row)
            return _at(self.children, 2 * row + jnp.where(goes_left, 0, 1))

        root = tree * self.value.shape[1]
        return jax.lax.fori_loop(0, self.depth, down, root) - root


def _at(values: Array | ndarray, index: Int[Array, " lanes"]) -> Array:
    return jnp.asarray(values).at[index].get(mode="promise_in_bounds")
