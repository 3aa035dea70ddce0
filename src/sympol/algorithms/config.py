"""The configuration of a training: every hyperparameter with its unit and its rule. Nothing here imports JAX."""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections import namedtuple
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np

from .growth import NUM_STAGES, num_minibatches
from .knobs import ConfigError, Range, as_plain, check, knob, knobs_of
from .registry import ALGORITHMS

MAX_TIMESTEPS = 2**29
MOST_LAYERS, WIDEST = 8, 8192
"""The limits of an MLP, so that its weights can be counted in 32 bits."""


@dataclass(frozen=True)
class Config:
    """The actor, the critic and the hyperparameters that they are trained with.

    Each field is declared once, with its rule (`sympol.algorithms.knobs`). Some belong to one policy or one algorithm;
    with others they must keep their defaults.

    Raises:
        ConfigError: A value breaks its rule.
    """

    algorithm: str = knob("ppo")
    """The algorithm: ppo, proximal policy optimization; a2c, advantage actor-critic; or one added to ALGORITHMS."""

    policy: Literal["tree", "mlp", "sdt"] = knob("tree")
    """The actor: a hard decision tree, or a baseline: a multilayer perceptron or a soft decision tree."""

    method: Literal["direct", "auto"] = knob("direct", only=("tree",))
    """The way to a tree. direct: the tree is trained from the first step. auto: an MLP is trained for about half of the
    steps, a small tree is distilled from it, and this tree is trained and grown for the rest; if the MLP has learned
    nothing, the tree is trained from a single leaf. All steps count."""

    total_timesteps: int = knob(1_000_000, low=1, high=MAX_TIMESTEPS)
    """Environment steps to train for. The rollout in which they are reached is completed."""

    depth: int = knob(5, low=1, high=14, only=("tree", "sdt"), search=Range(4, 8))
    """Depth of the tree or soft tree, 1 to 14: 2^depth leaves before pruning."""

    max_nodes: int = knob(0, low=0, high=2**15 - 1, only=("tree",))
    """The largest number of nodes of the tree, leaves included: an odd number; 0 for no limit. The first half of the
    training (a quarter with dynamic_rollout) has no limit; then the best tree is pruned by return, and training
    continues in that shape."""

    node_price: float = knob(0.0, low=0, high=1e9, only=("tree",))
    """The return that a node must be worth to survive that pruning; 0 keeps every node."""

    actor_hidden: tuple[int, ...] = knob((64, 64), only=("mlp",))
    """Widths of the hidden layers of an MLP actor."""

    surrogate: Literal["sigmoid", "softsign"] = knob("sigmoid", only=("tree",))
    """The function whose derivative stands in for that of the hard step: the logistic function, as in the paper, or
    softsign."""

    temperature: float = knob(
        1.0, low=2**-10, high=2**10, only=("tree", "sdt"), search=(0.01, 0.05, 0.1, 0.5, 1.0)
    )
    """In the backward pass the step is S(z / temperature): the lower, the narrower the strip around a threshold in
    which observations move it. For a tree it must be a power of two, so that the division is exact. A soft tree's
    gates use it in the forward pass, too, and there it may be any number."""

    critic: Literal["mlp", "tree", "sdt"] = knob("mlp", search=("mlp", "sdt"))
    """The value function: an MLP, or a tree or soft tree with the actor's architecture."""

    critic_hidden: tuple[int, ...] = knob((64, 64))
    """Widths of the hidden layers of an MLP critic."""

    normalize_obs: bool = knob(True)
    """Scale each feature to about ±1 by an affine map that is frozen before the first update. The extracted tree has
    thresholds in raw units, exactly."""

    trust_bounds: bool = knob(False)
    """Scale features with finite bounds by these bounds. Otherwise features are scaled by the mean and standard
    deviation of the first chunk of experience, which is used for nothing else."""

    scale_actions: bool = knob(False)
    """Sample continuous actions in units of about half the range of their bounds, from the middle of it; the tree
    itself is in the environment's units, exactly. Without, the policy begins near 0 with a standard deviation of
    exp(log_std_init) in the environment's units."""

    normalize_returns: bool = knob(False)
    """Let the critic learn returns at mean 0 and standard deviation 1, as they have been so far; the scale moves with
    them, and its predictions stay what they are."""

    num_envs: int = knob(32, low=1, high=65536, search=Range(4, 16))
    """Environments stepped in parallel."""

    num_devices: int = knob(1, low=1, high=65536)
    """Devices that the environments are distributed over, where they are stepped inside the compiled program. The
    result differs by the order of floating-point sums only."""

    num_steps: int = knob(128, low=1, high=2**20, search=(128, 512))
    """Steps of each environment in a rollout. A dynamic rollout starts at max(16, num_steps // 8)."""

    minibatch_size: int = knob(256, low=1, high=2**24, only=("ppo",), search=(64, 128, 256, 512))
    """Samples of an optimizer step, at least; rounded up so that it divides the first rollout."""

    num_epochs: int = knob(4, low=1, high=1000, only=("ppo",), search=Range(1, 10))
    """Passes over each rollout."""

    dynamic_rollout: bool = knob(True)
    """Double the rollout from each of eight equal stages of the training to the next."""

    growth: int = knob(128, low=1, high=128)
    """The factor by which a dynamic rollout grows at most: a power of two."""

    dynamic_batch: bool = knob(True, only=("ppo",))
    """Grow the batch by the same factor, through gradient accumulation."""

    norm_adv: bool = knob(True, search=(False, True))
    """Scale the advantages of each rollout to mean 0 and standard deviation 1."""

    reduce_lr: bool = knob(True, search=(False, True))
    """Halve the learning rates when the validation return has not improved for five evaluations."""

    rollback: bool = knob(True)
    """Continue from the best tree instead of the last one whenever reduce_lr halves the learning rates."""

    select_best: bool = knob(True)
    """Return the tree with the best validation return instead of the last one."""

    num_evals: int = knob(20, low=1, high=10_000)
    """Validations during training, evenly spaced. The run is saved after each."""

    num_eval_episodes: int = knob(32, low=1, high=100_000)
    """Episodes of each validation, on seeds used for nothing else."""

    eval_share: float = knob(0.0, low=0, high=100)
    """The most environment steps of all validations together, as a part of the training's, where the host steps the
    environment: a validation plays fewer than num_eval_episodes episodes where these would take longer, but at least
    four. 0 always plays all."""

    learning_rate_feature_logits: float = knob(
        0.01, low=0, high=10, traced=True, only=("tree",), search=Range(1e-4, 0.1, log=True)
    )
    """Adam learning rate of the choice of features."""

    learning_rate_thresholds: float = knob(
        0.002, low=0, high=10, traced=True, only=("tree",), search=Range(1e-4, 0.05, log=True)
    )
    """Adam learning rate of the thresholds."""

    learning_rate_leaf_values: float = knob(
        0.01, low=0, high=10, traced=True, only=("tree",), search=Range(1e-4, 0.05, log=True)
    )
    """Adam learning rate of the leaves."""

    learning_rate_actor: float = knob(
        0.001, low=0, high=10, traced=True, only=("mlp", "sdt"), search=Range(1e-4, 1e-2, log=True)
    )
    """Adam learning rate of an actor that is an MLP or a soft tree."""

    learning_rate_log_std: float = knob(0.001, low=0, high=10, traced=True, search=Range(1e-4, 0.1, log=True))
    """Adam learning rate of the log standard deviation of continuous actions."""

    learning_rate_critic: float = knob(0.001, low=0, high=10, traced=True, search=Range(1e-4, 1e-2, log=True))
    """Adam learning rate of the critic."""

    lr_end_factor: float = knob(1.0, low=0, high=1, traced=True)
    """Learning rates change linearly to this fraction of their initial value; 1 keeps them constant."""

    weight_decay: float = knob(1e-4, low=0, high=10, traced=True)
    """AdamW's decoupled weight decay of a tree's feature logits and leaf values (never of its thresholds), or of all
    parameters of another actor; 0 is plain Adam."""

    max_grad_norm: float = knob(
        math.inf, low=1e-6, high=math.inf, traced=True, search=(0.1, 0.5, 1.0, math.inf)
    )
    """The norm that the gradients of actor and critic are each clipped to; inf does not clip."""

    gamma: float = knob(0.99, low=0, high=1, traced=True, search=(0.9, 0.95, 0.99, 0.999))
    """Discount factor per step."""

    gae_lambda: float = knob(0.95, low=0, high=1, traced=True, search=(0.8, 0.9, 0.95, 0.99))
    """λ of generalized advantage estimation."""

    clip_eps: float = knob(0.2, low=1e-6, high=100, traced=True, only=("ppo",))
    """The largest distance of the probability ratio from 1 that PPO rewards."""

    ent_coef: float = knob(0.01, low=0, high=100, traced=True, search=(0.0, 0.1, 0.2, 0.5))
    """Weight of the entropy bonus."""

    ent_end_factor: float = knob(1.0, low=-100, high=1, traced=True)
    """The entropy bonus changes linearly to this fraction of its initial weight; 1 keeps it constant. Below 0 it ends
    as a penalty, so that the policy learns to act without its noise."""

    vf_coef: float = knob(0.5, low=0, high=100, traced=True, search=(0.25, 0.5, 0.75))
    """Weight of the critic's loss."""

    log_std_init: float = knob(0.0, low=-10, high=3, traced=True)
    """Initial log standard deviation of continuous actions."""

    threshold_init: Literal["normal", "visited"] = knob("normal", only=("tree",))
    """Initial thresholds: normally distributed, or, with visited, each halfway between two random observations that
    reach the node, so that no leaf is empty. The latter uses the first chunk of experience for nothing else."""

    threshold_std_init: float = knob(0.3, low=0, high=1000, traced=True, only=("tree",))
    """Initial standard deviation of normally distributed thresholds, in scaled units. Splits beyond the observations
    that are visited at first decide nothing and hardly learn."""

    grow_splits: bool = knob(False, only=("tree",))
    """Begin with a single leaf, and split a leaf where the policy gradient of a rollout differs on the two sides of the
    best split by more than chance. Splits stay where they are placed, and only leaves learn. Otherwise all splits are
    there from the start, at random, and learn. With max_nodes the tree grows to that size and no further."""

    reward_scale: float = knob(1.0, low=1e-9, high=1e9, traced=True)
    """Factor of the rewards in learning, never in reports. The critic learns best where returns are about 1."""

    def __post_init__(self) -> None:
        """Convert every field to its own type and check it."""
        for field in dataclasses.fields(self):
            value = as_plain(field.name, getattr(self, field.name), field.default)
            object.__setattr__(self, field.name, value)
            check(field.name, value, KNOBS[field.name])
        _check_together(self)

    @property
    def chunk_steps(self) -> int:
        """The number of steps of the first, smallest rollout."""
        return max(16, self.num_steps // 8) if self.dynamic_rollout else self.num_steps

    @property
    def chunk_size(self) -> int:
        """The number of samples of the first rollout."""
        return self.chunk_steps * self.num_envs

    @property
    def num_minibatches(self) -> int:
        """The number of optimizer steps in an epoch of the first rollout."""
        return num_minibatches(self.chunk_size, self.minibatch_size)

    @property
    def max_stage(self) -> int:
        """The number of times the rollout doubles; whatever `growth` is, it never outgrows a stage of the training."""
        if not self.dynamic_rollout:
            return 0
        fit = int(math.log2(max(1, self.total_timesteps // NUM_STAGES // self.chunk_size)))
        return min(NUM_STAGES - 1, int(math.log2(self.growth)), fit)

    def hyperparameters(self) -> Hyperparameters:
        """Return the traced fields.

        Returns:
            Float32 scalars, as the compiled program takes them.
        """
        return Hyperparameters(*(np.float32(getattr(self, name)) for name in Hyperparameters._fields))

    def static(self) -> Config:
        """Return the config with the defaults of all fields that do not change the compiled program.

        Returns:
            The key of a program: configs with equal keys share one.
        """
        limits = () if self.grow_splits else SIZE_LIMITS
        others = (*Hyperparameters._fields, *limits)
        return dataclasses.replace(self, **{name: getattr(type(self), name) for name in others})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a config from plain values, as a TOML or JSON file holds them.

        Args:
            values: Values by field; lists stand for tuples. Fields left out have their defaults.

        Returns:
            The config.

        Raises:
            ConfigError: A field is unknown, or a value breaks its rule.
        """
        for name in values:
            if name not in KNOBS:
                near = difflib.get_close_matches(name, KNOBS, n=3)
                hint = f"; did you mean {', '.join(near)}?" if near else ""
                raise ConfigError(f"unknown config field {name!r}{hint}")
        as_tuples: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        return cls(**as_tuples)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields that this policy and algorithm have, as plain values for TOML and JSON.

        Returns:
            Values by field. The limits of a tree's size are left out where they do not limit anything.
        """
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(self).items()
            if applies(name, self.algorithm, self.policy) and (value or name not in SIZE_LIMITS)
        }


KNOBS = knobs_of(Config)
"""The rule of each field."""

Hyperparameters = namedtuple("Hyperparameters", [name for name, rule in KNOBS.items() if rule.traced])
"""The traced fields: float32 scalars, or arrays of them under `jax.vmap`."""

SIZE_LIMITS = ("max_nodes", "node_price")
"""The fields that limit the size of a tree; `sympol.search.size_limit` enforces them, or growth does."""


def applies(name: str, algorithm: str, policy: str) -> bool:
    """Return whether a field means anything for an algorithm and a policy.

    A field that belongs to one algorithm also belongs to those that list it in ``Algorithm.knobs``.
    """
    only = KNOBS[name].only
    return (
        not only or policy in only or algorithm in only or name in getattr(ALGORITHMS[algorithm], "knobs", ())
    )


def _check_together(config: Config) -> None:
    """Raise ConfigError at the first rule that concerns more than the range of one field."""
    if config.algorithm not in ALGORITHMS:
        raise ConfigError(
            f"algorithm must be one of {', '.join(ALGORITHMS)}, got {config.algorithm!r}; one of your own is added to "
            "sympol.algorithms.registry.ALGORITHMS by a module that is imported first: sympol --import MODULE COMMAND"
        )
    for name in ("actor_hidden", "critic_hidden"):
        if any(width < 1 for width in getattr(config, name)):
            raise ConfigError(f"{name} must hold positive widths, got {getattr(config, name)}")
        if len(widths := getattr(config, name)) > MOST_LAYERS or any(width > WIDEST for width in widths):
            raise ConfigError(
                f"{name} must hold at most {MOST_LAYERS} widths of at most {WIDEST:,} each, got {widths}"
            )
    if config.max_nodes and config.max_nodes % 2 == 0:
        raise ConfigError(
            f"max_nodes must be odd, as a tree has one leaf more than it has splits, got {config.max_nodes}: choose "
            f"{config.max_nodes - 1} or {config.max_nodes + 1}; 0 is no limit"
        )
    if config.num_envs % config.num_devices:
        raise ConfigError(
            f"num_devices must divide num_envs, {config.num_envs}, so that each device steps as many, got "
            f"{config.num_devices}"
        )
    if config.growth & (config.growth - 1):
        raise ConfigError(f"growth must be a power of two, as the rollout doubles, got {config.growth}")
    if config.policy == "tree" and math.frexp(config.temperature)[0] != 0.5:
        raise ConfigError(
            f"temperature must be a power of two, got {config.temperature}: dividing by anything else rounds, and "
            "would move observations across their thresholds"
        )
    if config.critic != "mlp" and config.critic != config.policy:
        raise ConfigError(
            f"critic must be mlp or, as it shares the actor's architecture, {config.policy!r}, got {config.critic!r}"
        )
    if config.method == "auto" and config.critic != "mlp":
        raise ConfigError(
            f"critic must be mlp with method auto, where it is the teacher's, got {config.critic!r}; choose it, or "
            "method direct"
        )
    if (
        config.policy == "tree"
        and config.method == "auto"
        and (not config.grow_splits or config.max_nodes == 1)
    ):
        what = f"max_nodes {config.max_nodes}" if config.grow_splits else "grow_splits False"
        raise ConfigError(
            f"with method auto the distilled tree grows, got {what}; choose method direct (--method direct), or leave "
            "that out"
        )
    if config.grow_splits and config.node_price:
        raise ConfigError(
            f"grow_splits must be False with a node_price, got node_price {config.node_price}: what its pruning cuts "
            "would grow again; limit the size by max_nodes instead"
        )
    for field in dataclasses.fields(config):
        if (
            not applies(field.name, config.algorithm, config.policy)
            and getattr(config, field.name) != field.default
        ):
            only = KNOBS[field.name].only
            mine = config.algorithm if set(only) & set(ALGORITHMS) else config.policy
            raise ConfigError(
                f"{field.name} belongs to {' and '.join(only)}; {mine} has none, so leave it out"
            )
    if config.total_timesteps < config.chunk_size:
        raise ConfigError(
            f"total_timesteps must cover one rollout of {config.chunk_steps} steps × {config.num_envs} "
            f"environments = {config.chunk_size}, got {config.total_timesteps}; train longer, or lower "
            "num_steps or num_envs"
        )
