"""The hyperparameters of PPO in an environment that has no preset: they follow the budget.

Every number was chosen on the development set of `studies/first_try` and judged on environments that it does not hold;
docs/design/training.md has the measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .config import Config
from .knobs import whole

ROLLOUTS = 64
"""A training has about so many rollouts of its first size: each is an occasion to grow."""
MORE_ROLLOUTS = 128
"""And so many where rollouts do not grow, or the tree learns only in the last part of the training."""
SMALLEST, LARGEST = 512, 4096
"""Samples of the first rollout, at least and at most."""
LONG = 1_000_000
"""From so many steps on, rollouts grow to eight times their first size, below to four."""
VERY_LONG = 4_000_000
"""From so many steps on, minibatches are four times as large: there are optimizer steps enough."""
STEPS_OF_VALIDATION = 5_000
"""A training validates after so many steps, but five times at least and twenty times at most."""
FEWEST = 5_000
"""With fewer steps there is no time for a teacher."""
_BOTH = {
    "dynamic_batch": False,
    "num_epochs": 10,
    "scale_actions": True,
    "normalize_returns": True,
    "reduce_lr": False,
    "rollback": False,
    "lr_end_factor": 0.1,
    "max_grad_norm": 0.5,
}


def recipe(given: Mapping[str, Any], *, policy: str = "tree", from_tree: bool = False) -> dict[str, Any]:
    """Return the hyperparameters for a budget.

    Args:
        given: Fields of the config that the user chose. The others follow from ``total_timesteps``, ``num_envs`` and
            ``method`` among them.
        policy: ``"tree"`` or ``"mlp"``.
        from_tree: Whether the training starts from a tree.

    Returns:
        Fields of a `Config` by name.
    """
    total_timesteps = whole(given.get("total_timesteps")) or Config.total_timesteps
    fields = {
        **_BOTH,
        "minibatch_size": 256 if total_timesteps >= VERY_LONG else 64,
        "num_evals": min(max(total_timesteps // STEPS_OF_VALIDATION, 5), 20),
        "eval_share": 0.0 if "num_eval_episodes" in given else 0.25,
    }
    if policy == "mlp":
        return {
            **fields,
            **_rollouts(given, total_timesteps / MORE_ROLLOUTS, grow=False),
            "weight_decay": 0.0,
            "learning_rate_actor": 0.001,
            "learning_rate_critic": 0.001,
            "ent_coef": 0.01,
            "ent_end_factor": 0.0,
        }
    fields |= {
        **_rollouts(given, total_timesteps / ROLLOUTS, grow=True),
        "depth": 7,
        "learning_rate_leaf_values": 0.003,
        "ent_coef": 0.03,
        "ent_end_factor": -1.0,
    }
    if from_tree or given.get("node_price"):  # splits that are there already
        return fields | {"learning_rate_feature_logits": 0.001, "learning_rate_thresholds": 0.0005}
    fields |= {"grow_splits": True, "learning_rate_feature_logits": 0.0, "learning_rate_thresholds": 0.0}
    needs_none = given.get("critic", "mlp") != "mlp" or given.get("max_nodes") == 1
    if total_timesteps < FEWEST or given.get("method") == "direct" or needs_none:
        return fields
    return fields | {
        "method": "auto",
        "depth": 10,
        "max_nodes": 255,
        **_rollouts(given, total_timesteps / MORE_ROLLOUTS, grow=False),
        "ent_coef": 0.02,
        "learning_rate_leaf_values": 0.01,
    }


def _rollouts(given: Mapping[str, Any], wanted: float, *, grow: bool) -> dict[str, Any]:
    """Return how many environments there are, and how many steps each takes, for first rollouts of about a size."""
    total_timesteps = whole(given.get("total_timesteps")) or Config.total_timesteps
    first = min(max(_power_of_two(wanted), SMALLEST), LARGEST, total_timesteps)
    num_envs = whole(given.get("num_envs")) or (16 if first <= 2048 else Config.num_envs)
    num_steps = max(1, first // num_envs)
    if not grow:
        return {"num_envs": num_envs, "num_steps": num_steps, "dynamic_rollout": False}
    growth = 8 if total_timesteps >= LONG else 4
    return {"num_envs": num_envs, "num_steps": 8 * num_steps, "growth": growth}


def _power_of_two(number: float) -> int:
    """Return the nearest power of two that is not smaller."""
    return 1 << max(0, int(number - 1e-9)).bit_length()
