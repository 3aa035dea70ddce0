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

MAX_TIMESTEPS = 2**29


class ConfigError(ValueError):
    """A configuration that cannot be trained; the message names the value, the rule and the remedy."""


class Hyperparameters(NamedTuple):
    """The traced numbers, float32 scalars (or arrays of them under `jax.vmap`)."""

    learning_rate_feature_logits: Any
    learning_rate_thresholds: Any
    learning_rate_leaf_values: Any
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
class PPOConfig:
    """Proximal policy optimisation of a tree actor with an MLP critic (policy.md, Training)."""

    total_timesteps: int = 1_000_000
    """Environment steps to train for; the rollout in progress is finished."""

    depth: int = 5
    """Depth of the tree, 1 to 14: 2^depth leaves before pruning."""

    surrogate: Literal["sigmoid", "softsign"] = "sigmoid"
    """What the hard step becomes going backward: the logistic function (the paper) or softsign."""

    temperature: float = 1.0
    """Going backward the step is S(z / temperature): the lower, the narrower the strip around a threshold whose
    observations move it. A power of two, so that the division is exact."""

    critic: Literal["mlp", "tree"] = "mlp"
    """The value function: an MLP, or a tree of the actor's architecture (an ablation of the paper)."""

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

    num_steps: int = 128
    """Steps of each environment a rollout. A dynamic rollout starts at max(16, num_steps // 8)."""

    minibatch_size: int = 256
    """Samples behind one optimiser step, at least; rounded up to divide the first rollout."""

    num_epochs: int = 4
    """Passes over each rollout."""

    dynamic_rollout: bool = True
    """Double the rollout in eight equal stages, up to 128-fold."""

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

    learning_rate_log_std: float = 0.001
    """Adam step size of the log standard deviation (continuous actions)."""

    learning_rate_critic: float = 0.001
    """Adam step size of the critic."""

    lr_end_factor: float = 1.0
    """Learning rates fall linearly to this fraction of themselves; 1 keeps them."""

    weight_decay: float = 1e-4
    """AdamW's decoupled decay of feature logits and leaf values (never thresholds); 0 is plain Adam."""

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

    threshold_std_init: float = 0.3
    """Initial standard deviation of the thresholds, in scaled units. Splits that lie beyond what is visited at first
    decide nothing and hardly learn."""

    reward_scale: float = 1.0
    """Rewards are multiplied by this for learning (never in reports); the critic likes returns of about 1."""

    def __post_init__(self) -> None:
        """Check every field; raise `ConfigError` at the first that breaks its rule."""
        for field in dataclasses.fields(self):
            _check_type(field.name, getattr(self, field.name), getattr(type(self), field.name))
        for name, low, high in _RANGES:
            value = getattr(self, name)
            if not low <= value <= high:
                hint = (
                    f"; a tree of depth {value} has 2^{value} leaves"
                    if name == "depth" and value > high
                    else ""
                )
                raise ConfigError(f"{name} must be between {low} and {high}, got {value}{hint}")
        for name, choices in (("surrogate", ("sigmoid", "softsign")), ("critic", ("mlp", "tree"))):
            if getattr(self, name) not in choices:
                raise ConfigError(f"{name} must be one of {', '.join(choices)}, got {getattr(self, name)!r}")
        if math.frexp(self.temperature)[0] != 0.5:
            raise ConfigError(
                f"temperature must be a power of two, got {self.temperature}: dividing by anything else rounds, and "
                "would move observations across their thresholds"
            )
        if any(width < 1 for width in self.critic_hidden):
            raise ConfigError(f"critic_hidden must hold positive widths, got {self.critic_hidden}")
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
        """How often the rollout doubles: seven times, but a rollout never outgrows a stage of the training."""
        if not self.dynamic_rollout:
            return 0
        fit = int(math.log2(max(1, self.total_timesteps // NUM_STAGES // self.chunk_size)))
        return min(NUM_STAGES - 1, fit)

    def hyperparameters(self) -> Hyperparameters:
        """The traced fields as float32 numbers."""
        return Hyperparameters(*(np.float32(getattr(self, name)) for name in Hyperparameters._fields))

    def static(self) -> PPOConfig:
        """The config with its traced fields at their defaults: the key of a compiled program."""
        defaults = {name: getattr(PPOConfig, name) for name in Hyperparameters._fields}
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
        """Plain values, for TOML and JSON."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(self).items()}


_RANGES: tuple[tuple[str, float, float], ...] = (
    ("total_timesteps", 1, MAX_TIMESTEPS),
    ("depth", 1, 14),
    ("num_envs", 1, 65536),
    ("num_steps", 1, 2**20),
    ("minibatch_size", 1, 2**24),
    ("num_epochs", 1, 1000),
    ("num_evals", 1, 10_000),
    ("num_eval_episodes", 1, 100_000),
    ("learning_rate_feature_logits", 0, 10),
    ("learning_rate_thresholds", 0, 10),
    ("learning_rate_leaf_values", 0, 10),
    ("learning_rate_log_std", 0, 10),
    ("learning_rate_critic", 0, 10),
    ("lr_end_factor", 0, 1),
    ("weight_decay", 0, 10),
    ("max_grad_norm", 1e-6, math.inf),
    ("gamma", 0, 1),
    ("gae_lambda", 0, 1),
    ("clip_eps", 1e-6, 100),
    ("ent_coef", 0, 100),
    ("ent_end_factor", -100, 1),
    ("vf_coef", 0, 100),
    ("log_std_init", -10, 3),
    ("reward_scale", 1e-9, 1e9),
    ("threshold_std_init", 0, 1000),
    ("temperature", 2**-10, 2**10),
)


def _check_type(name: str, value: object, default: object) -> None:
    """A field has the type of its default; a whole number will do for a float, a bool for nothing else."""
    match default:
        case bool():
            good, kind = isinstance(value, bool), "true or false"
        case int():
            good, kind = isinstance(value, int) and not isinstance(value, bool), "a whole number"
        case float():
            whole = isinstance(value, int) and not isinstance(value, bool)
            good, kind = whole or (isinstance(value, float) and not math.isnan(value)), "a number"
        case tuple():
            good = isinstance(value, tuple) and all(type(v) is int for v in value)
            kind = "a list of whole numbers"
        case _:
            good, kind = isinstance(value, str), "a word"
    if not good:
        raise ConfigError(f"{name} must be {kind}, got {value!r}")
