"""The state of a training between two segments: a pytree that can be saved, and continued to the bit."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax import Array
from jaxtyping import Bool, Float, Int, UInt32

from ..policies.actor import Actor
from ..policies.mlp import MLP
from ..policies.soft_tree import SoftTree
from ..policies.tree import Tree

PATIENCE = 5
"""Validations without improvement before the learning rates are halved."""


class Networks(NamedTuple):
    """The parameters that are trained; actor and critic share no parameters.

    Attributes:
        actor: The policy, an `Actor`.
        critic: The value function.
    """

    actor: Any
    critic: MLP | Tree | SoftTree


class Normalizer(NamedTuple):
    """The affine map ``(x − shift) · scale`` between the environment and the networks; frozen once it is fitted.

    Attributes:
        shift: One number per feature.
        scale: One number per feature. NaN in ``shift`` marks features that cannot be scaled.
    """

    shift: Float[Array, " features"]
    scale: Float[Array, " features"]

    def __call__(self, x: Float[Array, "*batch features"]) -> Float[Array, "*batch features"]:
        """Return observations of about unit scale."""
        shape = (1,) * (x.ndim - 1) + self.shift.shape
        return (x - self.shift.reshape(shape)) * self.scale.reshape(shape)

    def where_valid(self, valid: Bool[Array, " features"]) -> Normalizer:
        """Return a normalizer that is NaN for invalid features: a compiled program cannot raise an error."""
        return self._replace(shift=jnp.where(valid, self.shift, jnp.nan))

    def is_valid(self) -> Bool[Array, ""]:
        """Return whether all features can be scaled."""
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
        """Return the statistics before the first step."""
        return Episodes(
            jnp.zeros(num_envs), jnp.zeros(num_envs, jnp.int32), jnp.float32(0), jnp.int32(0), jnp.int32(0)
        )

    def step(
        self,
        reward: Float[Array, " envs"],
        done: Bool[Array, " envs"],
        counts: Bool[Array, " envs"] | None = None,
    ) -> Episodes:
        """Count one step of every environment, or of those that count."""
        if counts is not None:
            reward, done = jnp.where(counts, reward, 0), done & counts
        total = self.running_return + reward
        length = self.running_length + (1 if counts is None else counts.astype(jnp.int32))
        return Episodes(
            jnp.where(done, 0.0, total),
            jnp.where(done, 0, length),
            self.sum_return + jnp.sum(jnp.where(done, total, 0.0)),
            self.sum_length + jnp.sum(jnp.where(done, length, 0)),
            self.num_ended + jnp.sum(done, dtype=jnp.int32),
        )

    def steps(
        self,
        reward: Float[Array, "steps envs"],
        done: Bool[Array, "steps envs"],
        counts: Bool[Array, "steps envs"] | None = None,
    ) -> Episodes:
        """Count several steps, one after the other."""
        return jax.lax.scan(lambda e, step: (e.step(*step), None), self, (reward, done, counts))[0]

    def after_report(self) -> Episodes:
        """Return the statistics with their sums back at zero."""
        return self._replace(sum_return=jnp.float32(0), sum_length=jnp.int32(0), num_ended=jnp.int32(0))


class Validation(NamedTuple):
    """Returns of the deterministic policy on validation seeds, the best actor so far, and the learning rate factor."""

    last_return: Float[Array, ""]
    best_return: Float[Array, ""]
    best_timestep: Int[Array, ""]
    best_actor: Actor
    num_bad: Int[Array, ""]
    lr_factor: Float[Array, ""]

    @staticmethod
    def create(actor: Actor) -> Validation:
        """Return the record before the first validation."""
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


class WarmStartState(NamedTuple):
    """The parts of the state that only a training that started from a tree has (`sympol.algorithms.warm_start`).

    Attributes:
        kept: The splits that came from the tree; the others pad it to a complete tree.
        frozen_splits: The splits that never change.
        frozen_leaves: The leaves that never change.
        critic_warmup: The fraction of the training in which only the critic learns.
    """

    kept: Bool[Array, " nodes"]
    frozen_splits: Bool[Array, " nodes"]
    frozen_leaves: Bool[Array, " leaves"]
    critic_warmup: Float[Array, ""]

    @staticmethod
    def zeros(depth: int) -> WarmStartState:
        """Return a state of the right shapes for a tree of this depth."""
        nodes = jnp.zeros(2**depth - 1, bool)
        return WarmStartState(nodes, nodes, jnp.zeros(2**depth, bool), jnp.float32(0))


class Guide(NamedTuple):
    """The part of the state that only the training of a tree with a teacher has (`sympol.guided`).

    Attributes:
        steps: Environment steps before the tree's own training: the teacher's training and the distillation.
        teacher_steps: Those of the teacher's training.
        teacher_return: The mean return of the teacher, playing its best actions.
        random_return: The mean return of random actions.
        tree_return: The mean return of the distilled tree.
        tree_length: The mean length of its episodes.
        is_distilled: Whether the training begins with that tree; otherwise with a single leaf.
        scale: The scale of the features that the teacher's critic was trained on.
    """

    steps: Int[Array, ""]
    teacher_steps: Int[Array, ""]
    teacher_return: Float[Array, ""]
    random_return: Float[Array, ""]
    tree_return: Float[Array, ""]
    tree_length: Float[Array, ""]
    is_distilled: Bool[Array, ""]
    scale: Normalizer

    @staticmethod
    def zeros(num_features: int) -> Guide:
        """Return a record of the right shapes."""
        nothing, count = jnp.float32(0), jnp.int32(0)
        scale = Normalizer(jnp.zeros(num_features), jnp.ones(num_features))
        return Guide(count, count, nothing, nothing, nothing, nothing, jnp.bool_(False), scale)


class TrainState(NamedTuple):
    """Everything that a training is.

    Attributes:
        networks: The parameters.
        opt_state: The state of the optimizer.
        normalizer: The scale of the features.
        outside: Which features were seen below (first row) and above (second row) the bounds of the space.
        env_state: The state of the environments; where the host steps them, the `RunningEpisodes` that lead to it.
        observation: The raw observations ``[envs, features]`` to act on next; None where the host steps them.
        key: Raw data of a JAX key, so that every leaf is a plain array.
        timestep: Environment steps so far.
        iteration: Rollouts so far.
        episodes: Statistics of the episodes of training.
        metrics: The metrics of the last update, by name; empty in a checkpoint.
        validation: The record of validations.
        memory: What the algorithm keeps beside its networks (`Algorithm.init_memory`).
        warm: What is remembered of the tree that training started from; None where it started at random.
        guide: What is remembered of the teacher; None for a training without one.
        was_cut: Whether the last validation cut an episode; None outside of a segment, so that no checkpoint has it.
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
    metrics: dict[str, Float[Array, ""]]
    validation: Validation
    memory: Any = None
    warm: WarmStartState | None = None
    guide: Guide | None = None
    was_cut: Bool[Array, ""] | None = None


def tree_where(condition: Bool[Array, "*batch"], if_true: Any, if_false: Any) -> Any:
    """`jnp.where` over pytrees whose leaves have the condition's axes first."""

    def choose(a: Array, b: Array) -> Array:
        return jnp.where(condition.reshape(condition.shape + (1,) * (jnp.ndim(a) - condition.ndim)), a, b)

    return jax.tree.map(choose, if_true, if_false)
