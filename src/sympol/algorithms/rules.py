"""What a field of a config may be: its range, its choices, and to which policies and algorithms it belongs."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import operator
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

if TYPE_CHECKING:
    from .config import Config


class ConfigError(ValueError):
    """A configuration that cannot be trained; the message names the value, the rule and the remedy."""


MAX_TIMESTEPS = 2**29
MOST_LAYERS, WIDEST = 8, 8192
"""Of an MLP, so that all its weights can be counted in 32 bits."""

RANGES: tuple[tuple[str, float, float], ...] = (
    ("total_timesteps", 1, MAX_TIMESTEPS),
    ("depth", 1, 14),
    ("max_nodes", 0, 2**15 - 1),
    ("node_price", 0, 1e9),
    ("num_envs", 1, 65536),
    ("num_devices", 1, 65536),
    ("num_steps", 1, 2**20),
    ("minibatch_size", 1, 2**24),
    ("num_epochs", 1, 1000),
    ("growth", 1, 128),
    ("num_evals", 1, 10_000),
    ("num_eval_episodes", 1, 100_000),
    ("learning_rate_feature_logits", 0, 10),
    ("learning_rate_thresholds", 0, 10),
    ("learning_rate_leaf_values", 0, 10),
    ("learning_rate_actor", 0, 10),
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

CHOICES = {
    "algorithm": ("ppo", "a2c"),
    "policy": ("tree", "mlp", "sdt"),
    "surrogate": ("sigmoid", "softsign"),
    "critic": ("mlp", "tree", "sdt"),
    "threshold_init": ("normal", "visited"),
}

LIMITS = ("max_nodes", "node_price")
"""Fields of how small a tree is to be (`sympol.search.size_limit`)."""

OWNERS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(LIMITS, ("tree",)),
    **dict.fromkeys(("depth", "temperature"), ("tree", "sdt")),
    **dict.fromkeys(
        (
            "surrogate",
            "threshold_init",
            "threshold_std_init",
            "learning_rate_feature_logits",
            "learning_rate_thresholds",
            "learning_rate_leaf_values",
        ),
        ("tree",),
    ),
    "actor_hidden": ("mlp",),
    "learning_rate_actor": ("mlp", "sdt"),
    **dict.fromkeys(("minibatch_size", "num_epochs", "dynamic_batch", "clip_eps"), ("ppo",)),
}
"""Fields that not everybody has, and who has them."""


def applies(name: str, algorithm: str, policy: str) -> bool:
    """Whether a field means anything for this algorithm and policy."""
    owners = OWNERS.get(name, (policy,))
    return policy in owners or algorithm in owners


def check_fields(config: Config) -> None:
    """Raise ConfigError at the first field that breaks its rule. The values are `plain` already."""
    for name, low, high in RANGES:
        value = getattr(config, name)
        if not low <= value <= high:
            deep = name == "depth" and value > high
            hint = f"; a tree of depth {value} has 2^{value} leaves" if deep else ""
            raise ConfigError(f"{name} must be between {low} and {high}, got {value}{hint}")
    for name, choices in CHOICES.items():
        if getattr(config, name) not in choices:
            raise ConfigError(f"{name} must be one of {', '.join(choices)}, got {getattr(config, name)!r}")
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
    for field in dataclasses.fields(config):
        if not applies(field.name, config.algorithm, config.policy):
            _check_unused(config, field.name)


def _check_unused(config: Config, name: str) -> None:
    if getattr(config, name) != getattr(type(config), name):
        owners = OWNERS[name]
        mine = config.algorithm if owners == ("ppo",) else config.policy
        raise ConfigError(f"{name} belongs to {' and '.join(owners)}; {mine} has none, so leave it out")


def plain(name: str, value: object, default: object) -> Any:
    """The value of a field as one of Python's own types, that of its default; a whole number will do for a float.

    NumPy's scalars are numbers, too, and 1e6 is a whole number. A bool will do for nothing else.

    Raises:
        ConfigError: a value of another type.
    """
    match default:
        case bool():
            taken, kind = bool(value) if _is_bool(value) else None, "true or false"
        case int():
            taken, kind = whole(value), "a whole number"
        case float():
            taken, kind = _number(value), "a number"
        case tuple():
            widths = tuple(whole(v) for v in value) if isinstance(value, tuple) else (None,)
            taken, kind = None if None in widths else widths, "a list of whole numbers"
        case _:
            taken, kind = str(value) if isinstance(value, str) else None, "a word"
    if taken is None:
        raise ConfigError(f"{name} must be {kind}, got {value!r}")
    return taken


def whole(value: object) -> int | None:
    """A whole number as an int, be it 3, ``np.int64(3)`` or 1e6; None of anything else, bools among it."""
    if _is_bool(value):
        return None
    if isinstance(value, SupportsIndex):
        with contextlib.suppress(TypeError):  # an array that holds no single whole number
            return operator.index(value)
    if isinstance(value, float | np.floating) and float(value).is_integer():
        return int(value)
    return None


def _number(value: object) -> float | None:
    if isinstance(value, float | np.floating):
        return None if math.isnan(value) else float(value)
    return whole(value)


def _is_bool(value: object) -> bool:
    return isinstance(value, bool | np.bool_) or getattr(value, "dtype", None) == np.bool_
