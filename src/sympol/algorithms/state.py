"""All that a training is, between two segments: a pytree that can be saved and continued to the bit."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Bool, Float, Int, UInt32

from ..policies.actor import Actor
from .optimizer import Networks

PATIENCE = 5
"""Validations without improvement before the learning rates are halved."""


class Normalizer(NamedTuple):
    """The frozen affine map ``(x − shift) · scale`` between the environment and the networks."""

    shift: Float[Array, " features"]
    scale: Float[Array, " features"]

    def __call__(self, x: Float[Array, "*batch features"]) -> Float[Array, "*batch features"]:
        """Observations of about unit scale."""
        shape = (1,) * (x.ndim - 1) + self.shift.shape
        return (x - self.shift.reshape(shape)) * self.scale.reshape(shape)

    def or_none(self, held: Bool[Array, " features"]) -> Normalizer:
        """Itself, with NaN for the features that cannot be scaled: a compiled program has no other way to say it."""
        return self._replace(shift=jnp.where(held, self.shift, jnp.nan))

    def is_there(self) -> Bool[Array, ""]:
        """Whether all features can be scaled."""
        return ~jnp.isnan(self.shift).any()


class Episodes(NamedTuple):
    """Returns of the running episodes, and sums over those that ended since the last report."""

    running_return: Float[Array, " envs"]
    running_length: Int[Array, " envs"]
    sum_return: Float[Array, ""]
    sum_length: Int[Array, ""]
    num_ended: Int[Array, ""]

    @staticmethod
    def zeros(num_envs: int) -> Episodes:
        """Nothing has happened yet."""
        return Episodes(
            jnp.zeros(num_envs), jnp.zeros(num_envs, jnp.int32), jnp.float32(0), jnp.int32(0), jnp.int32(0)
        )

    def step(self, reward: Float[Array, " envs"], done: Bool[Array, " envs"]) -> Episodes:
        """Count one step of every environment."""
        total, length = self.running_return + reward, self.running_length + 1
        return Episodes(
            jnp.where(done, 0.0, total),
            jnp.where(done, 0, length),
            self.sum_return + jnp.sum(jnp.where(done, total, 0.0)),
            self.sum_length + jnp.sum(jnp.where(done, length, 0)),
            self.num_ended + jnp.sum(done, dtype=jnp.int32),
        )

    def steps(self, reward: Float[Array, "steps envs"], done: Bool[Array, "steps envs"]) -> Episodes:
        """Count many steps, one after the other."""
        return jax.lax.scan(lambda e, step: (e.step(*step), None), self, (reward, done))[0]

    def reported(self) -> Episodes:
        """The sums start again."""
        return self._replace(sum_return=jnp.float32(0), sum_length=jnp.int32(0), num_ended=jnp.int32(0))


class Losses(NamedTuple):
    """Means over the last rollout's updates."""

    policy_loss: Float[Array, ""]
    value_loss: Float[Array, ""]
    entropy: Float[Array, ""]
    approx_kl: Float[Array, ""]
    clip_fraction: Float[Array, ""]

    @staticmethod
    def zeros() -> Losses:
        """Before the first update."""
        return Losses(*(jnp.float32(0) for _ in Losses._fields))


class Validation(NamedTuple):
    """What the deterministic tree earned on validation seeds, and what follows from it."""

    last_return: Float[Array, ""]
    best_return: Float[Array, ""]
    best_timestep: Int[Array, ""]
    best_actor: Actor
    num_bad: Int[Array, ""]
    lr_factor: Float[Array, ""]

    @staticmethod
    def create(actor: Actor) -> Validation:
        """Before the first validation."""
        nothing = jnp.float32(-jnp.inf)
        return Validation(nothing, nothing, jnp.int32(0), actor, jnp.int32(0), jnp.float32(1))

    def update(
        self, score: Float[Array, ""], timestep: Int[Array, ""], actor: Actor, *, reduce_lr: bool
    ) -> Validation:
        """Keep the best tree (higher is better; of equals the later).

        With ``reduce_lr`` the learning rates halve when five validations in a row brought nothing better.
        """
        improved = score > self.best_return
        keep = score >= self.best_return
        num_bad = jnp.where(improved, 0, self.num_bad + 1)
        plateau = (num_bad >= PATIENCE) & reduce_lr
        return Validation(
            last_return=score,
            best_return=jnp.where(keep, score, self.best_return),  # of a NaN, the one before
            best_timestep=jnp.where(keep, timestep, self.best_timestep),
            best_actor=tree_where(keep, actor, self.best_actor),
            num_bad=jnp.where(plateau, 0, num_bad),
            lr_factor=jnp.where(plateau, self.lr_factor / 2, self.lr_factor),
        )


class Warm(NamedTuple):
    """What a training that started from a tree remembers of it (`sympol.algorithms.warm_start`)."""

    kept: Bool[Array, " nodes"]
    """Splits that are the tree's; the others only filled up the complete tree."""
    frozen_splits: Bool[Array, " nodes"]
    frozen_leaves: Bool[Array, " leaves"]
    critic_warmup: Float[Array, ""]
    """The part of the training in which only the critic learns."""

    @staticmethod
    def create(depth: int) -> Warm:
        """Of a tree that is still to come."""
        nodes = jnp.zeros(2**depth - 1, bool)
        return Warm(nodes, nodes, jnp.zeros(2**depth, bool), jnp.float32(0))


class TrainState(NamedTuple):
    """See the module. ``env_state`` and ``observation`` are None where the host steps the environments.

    ``key`` is raw key data, so that every leaf is a plain array. ``outside`` says which features were seen below
    (first row) and above (second row) the bounds that the environment promised.
    """

    networks: Networks
    opt_state: optax.OptState
    normalizer: Normalizer
    outside: Bool[Array, "2 features"]
    env_state: Any
    observation: Any
    key: UInt32[Array, "2"]
    timestep: Int[Array, ""]
    iteration: Int[Array, ""]
    episodes: Episodes
    losses: Losses
    validation: Validation
    warm: Warm | None = None
    """None where training began with random networks."""
    cut: Bool[Array, ""] | None = None
    """Whether the last validation cut an episode; inside the compiled program only, and so in no checkpoint."""


def tree_where(condition: Bool[Array, "*batch"], if_true: Any, if_false: Any) -> Any:
    """`jnp.where` over pytrees whose leaves have the condition's axes first."""

    def choose(a: Array, b: Array) -> Array:
        return jnp.where(condition.reshape(condition.shape + (1,) * (jnp.ndim(a) - condition.ndim)), a, b)

    return jax.tree.map(choose, if_true, if_false)
