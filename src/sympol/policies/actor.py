"""The interface of every actor: outputs for observations, and a log standard deviation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from jax import Array
from jaxtyping import Float


class Actor(Protocol):
    """A pytree of parameters with a forward pass; `Tree`, `MLPActor` and `SoftTree` are the ones there are."""

    @property
    def log_std(self) -> Float[Array, " num_std"]:
        """One entry per continuous action dimension, none for discrete actions."""
        ...

    def __call__(self, x: Float[Array, "batch features"]) -> Float[Array, "batch outputs"]:
        """Logits or means, differentiable."""
        ...

    def rollout(self) -> Callable[[Float[Array, "batch features"]], Float[Array, "batch outputs"]]:
        """The same function as a pytree made for acting, nothing to differentiate."""
        ...
