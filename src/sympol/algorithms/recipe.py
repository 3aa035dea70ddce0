"""The hyperparameters of a tree trained by PPO in an environment that has no preset: they follow the budget.

Every number was chosen on the development set of `studies/first_try` and judged on environments that it does not hold;
docs/design/recipe.md has the measurements.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .config import Config
from .knobs import whole

ROLLOUTS = 64
"""A training has about so many rollouts of its first size: each is an occasion to grow."""
SMALLEST, LARGEST = 512, 4096
"""Samples of the first rollout, at least and at most."""
LONG = 1_000_000
"""From so many steps on, rollouts grow to eight times their first size, below to four."""
VERY_LONG = 4_000_000
"""From so many steps on, minibatches are four times as large: there are optimizer steps enough."""
STEPS_OF_VALIDATION = 5_000
"""A training validates after so many steps, but five times at least and twenty times at most."""


def recipe(given: Mapping[str, Any], *, from_tree: bool = False) -> dict[str, Any]:
    """Return the hyperparameters for a budget.

    Args:
        given: Fields of the config that the user chose. The others follow from ``total_timesteps`` and ``num_envs``
            among them.
        from_tree: Whether the training starts from a tree, which then keeps most of its splits.

    Returns:
        Fields of a `Config` by name.
    """
    total_timesteps = whole(given.get("total_timesteps")) or Config.total_timesteps
    first = min(max(_power_of_two(total_timesteps / ROLLOUTS), SMALLEST), LARGEST, total_timesteps)
    num_envs = whole(given.get("num_envs")) or Config.num_envs
    num_envs = min(num_envs, 16) if first <= 1024 and num_envs == Config.num_envs else num_envs
    literal = given.get("num_eval_episodes", Config.num_eval_episodes) != Config.num_eval_episodes
    fields = {
        "depth": 7,
        "num_envs": num_envs,
        "num_steps": 8 * max(1, first // num_envs),
        "growth": 8 if total_timesteps >= LONG else 4,
        "dynamic_batch": False,
        "num_epochs": 10,
        "minibatch_size": 256 if total_timesteps >= VERY_LONG else 64,
        "num_evals": min(max(total_timesteps // STEPS_OF_VALIDATION, 5), 20),
        "eval_share": 0.0 if literal else 0.25,
        "scale_actions": True,
        "normalize_returns": True,
        "reduce_lr": False,
        "rollback": False,
        "lr_end_factor": 0.1,
        "max_grad_norm": 0.5,
        "ent_coef": 0.03,
        "ent_end_factor": -1.0,
        "learning_rate_leaf_values": 0.003,
    }
    if from_tree or given.get("node_price"):  # splits that are there already
        return fields | {"learning_rate_feature_logits": 0.001, "learning_rate_thresholds": 0.0005}
    return fields | {
        "grow_splits": True,
        "learning_rate_feature_logits": 0.0,
        "learning_rate_thresholds": 0.0,
    }


def _power_of_two(number: float) -> int:
    """Return the nearest power of two that is not smaller."""
    return 1 << max(0, int(number - 1e-9)).bit_length()
