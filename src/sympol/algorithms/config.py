"""What a training is made of: every knob, its unit, its rule.

Fields are *static* (shapes and switches: another value is another compiled program) or *traced* (plain
numbers: one program serves all values, and `jax.vmap` may map over them). `Hyperparameters` lists the traced.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from ..functional.schedules import NUM_STAGES, num_minibatches
from .rules import LIMITS, ConfigError, applies, check_fields, plain


class Hyperparameters(NamedTuple):
    """The traced numbers, float32 scalars (or arrays of them under `jax.vmap`)."""

    learning_rate_feature_logits: Any
    learning_rate_thresholds: Any
    learning_rate_leaf_values: Any
    learning_rate_actor: Any
    learning_rate_log_std: Any
    learning_rate_critic: Any
    lr_end_factor: Any
    weight_decay: Any
    max_grad_norm: Any
    gamma: Any
    gae_lambda: Any
    clip_eps: Any
    ent_coef: Any
    ent_end_factor: Any
    vf_coef: Any
    log_std_init: Any
    reward_scale: Any
    threshold_std_init: Any


@dataclass(frozen=True)
class Config:
    """An actor, a critic, and how they are trained (policy.md, Training).

    Some fields belong to one policy or one algorithm (`rules.OWNERS`); with another they must stay at their defaults.
    """

    algorithm: Literal["ppo", "a2c"] = "ppo"
    """Proximal policy optimisation, or advantage actor-critic."""

    policy: Literal["tree", "mlp", "sdt"] = "tree"
    """What acts: a hard decision tree, or a rival: a multilayer perceptron, a soft decision tree."""

    total_timesteps: int = 1_000_000
    """Environment steps to train for; the rollout in progress is finished."""

    depth: int = 5
    """Depth of the tree or soft tree, 1 to 14: 2^depth leaves before pruning."""

    max_nodes: int = 0
    """The most nodes that the tree may have, leaves among them: an odd number; 0 for no limit. Half of the
    training is free, a quarter with dynamic_rollout; then the best tree is pruned by what it earns, and trained on in
    that shape."""

    node_price: float = 0.0
    """The return that a node must be worth, or it is pruned at that moment; 0 for no price."""

    actor_hidden: tuple[int, ...] = (64, 64)
    """Width of each hidden layer of the MLP that acts."""

    surrogate: Literal["sigmoid", "softsign"] = "sigmoid"
    """What the hard step becomes going backward: the logistic function (the paper) or softsign."""

    temperature: float = 1.0
    """Going backward the step is S(z / temperature): the lower, the narrower the strip around a threshold whose
    observations move it. A power of two, so that the division is exact. A soft tree's gates have it, too, going
    forward; there any number will do."""

    critic: Literal["mlp", "tree", "sdt"] = "mlp"
    """The value function: an MLP, or a tree or soft tree of the actor's architecture."""

    critic_hidden: tuple[int, ...] = (64, 64)
    """Width of each hidden layer of the MLP critic."""

    normalize_obs: bool = True
    """Scale each feature to about ±1 by an affine map frozen before the first update. The extracted tree
    speaks raw units, exactly."""

    trust_bounds: bool = False
    """Scale features that have finite bounds by them. Otherwise, and where there are none, by the mean and spread of
    the first chunk, which is spent on that."""

    num_envs: int = 32
    """Environments stepped side by side."""

    num_devices: int = 1
    """Devices that the environments are spread over, where they are stepped inside the compiled program. The result is
    the same but for the order of float sums."""

    num_steps: int = 128
    """Steps of each environment a rollout. A dynamic rollout starts at max(16, num_steps // 8)."""

    minibatch_size: int = 256
    """Samples behind one optimiser step, at least; rounded up to divide the first rollout."""

    num_epochs: int = 4
    """Passes over each rollout."""

    dynamic_rollout: bool = True
    """Double the rollout from stage to stage, of which there are eight, all equal."""

    growth: int = 128
    """A dynamic rollout stops growing when it is so many times as long as at first; a power of two."""

    dynamic_batch: bool = True
    """Grow the batch by the same factor, by gradient accumulation."""

    norm_adv: bool = True
    """Scale the advantages of each rollout to mean 0, standard deviation 1."""

    reduce_lr: bool = True
    """Halve the learning rates when the validation return has not improved for five evaluations."""

    rollback: bool = True
    """When reduce_lr halves the learning rates, go on from the best tree, not from the last."""

    select_best: bool = True
    """Return the tree with the best validation return, not the last one."""

    num_evals: int = 20
    """Validations during training, evenly spaced; also how often the run is saved."""

    num_eval_episodes: int = 32
    """Episodes of each validation, on seeds of their own."""

    learning_rate_feature_logits: float = 0.01
    """Adam step size of the choice of features."""

    learning_rate_thresholds: float = 0.002
    """Adam step size of the thresholds."""

    learning_rate_leaf_values: float = 0.01
    """Adam step size of the leaves."""

    learning_rate_actor: float = 0.001
    """Adam step size of an actor that is an MLP or a soft tree."""

    learning_rate_log_std: float = 0.001
    """Adam step size of the log standard deviation (continuous actions)."""

    learning_rate_critic: float = 0.001
    """Adam step size of the critic."""

    lr_end_factor: float = 1.0
    """Learning rates fall linearly to this fraction of themselves; 1 keeps them."""

    weight_decay: float = 1e-4
    """AdamW's decoupled decay of feature logits and leaf values (never a tree's thresholds), or of all of another
    actor; 0 is plain Adam."""

    max_grad_norm: float = math.inf
    """Gradients of actor and critic are each clipped to this norm; inf does not clip."""

    gamma: float = 0.99
    """Discount a step."""

    gae_lambda: float = 0.95
    """λ of generalised advantage estimation."""

    clip_eps: float = 0.2
    """How far the probability ratio may move from 1."""

    ent_coef: float = 0.01
    """Weight of the entropy bonus."""

    ent_end_factor: float = 1.0
    """The entropy bonus moves linearly to this fraction of itself; 1 keeps it. Below 0 it ends as a price, so that the
    tree learns to do without its noise."""

    vf_coef: float = 0.5
    """Weight of the critic's loss."""

    log_std_init: float = 0.0
    """Initial log standard deviation (continuous actions)."""

    threshold_init: Literal["normal", "visited"] = "normal"
    """Where splits lie at first: at random thresholds, or each between two random observations of those that come by
    it, so that no leaf is empty. For the latter the first chunk is spent."""

    threshold_std_init: float = 0.3
    """Initial standard deviation of normal thresholds, in scaled units. Splits that lie beyond what is visited at first
    decide nothing and hardly learn."""

    reward_scale: float = 1.0
    """Rewards are multiplied by this for learning (never in reports); the critic likes returns of about 1."""

    def __post_init__(self) -> None:
        """Check every field; raise `ConfigError` at the first that breaks its rule."""
        for field in dataclasses.fields(self):
            value = plain(field.name, getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)
        check_fields(self)
        if self.total_timesteps < self.chunk_size:
            raise ConfigError(
                f"total_timesteps must cover one rollout of {self.chunk_steps} steps × {self.num_envs} "
                f"environments = {self.chunk_size}, got {self.total_timesteps}; train longer, or lower "
                "num_steps or num_envs"
            )

    @property
    def chunk_steps(self) -> int:
        """Steps of the first, smallest rollout."""
        return max(16, self.num_steps // 8) if self.dynamic_rollout else self.num_steps

    @property
    def chunk_size(self) -> int:
        """Samples of the first rollout."""
        return self.chunk_steps * self.num_envs

    @property
    def num_minibatches(self) -> int:
        """Optimiser steps an epoch of the first rollout."""
        return num_minibatches(self.chunk_size, self.minibatch_size)

    @property
    def max_stage(self) -> int:
        """How often the rollout doubles; however large `growth`, it never outgrows a stage of the training."""
        if not self.dynamic_rollout:
            return 0
        fit = int(math.log2(max(1, self.total_timesteps // NUM_STAGES // self.chunk_size)))
        return min(NUM_STAGES - 1, int(math.log2(self.growth)), fit)

    def hyperparameters(self) -> Hyperparameters:
        """The traced fields as float32 numbers."""
        return Hyperparameters(*(np.float32(getattr(self, name)) for name in Hyperparameters._fields))

    def static(self) -> Config:
        """The config with its traced fields at their defaults: the key of a compiled program."""
        others = (*Hyperparameters._fields, *LIMITS)  # what no program depends on
        defaults = {name: getattr(type(self), name) for name in others}
        return dataclasses.replace(self, **defaults)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """A config from plain values; an unknown field is an error that names its neighbours."""
        known = {field.name for field in dataclasses.fields(cls)}
        for name in values:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=3)
                hint = f"; did you mean {', '.join(near)}?" if near else ""
                raise ConfigError(f"unknown config field {name!r}{hint}")
        as_tuples: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        return cls(**as_tuples)

    def to_dict(self) -> dict[str, Any]:
        """Plain values of the fields that this policy and algorithm have, for TOML and JSON.

        Limits only where there are any: what was written before there were such fields says the same.
        """
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(self).items()
            if applies(name, self.algorithm, self.policy) and (value or name not in LIMITS)
        }
