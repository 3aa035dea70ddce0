"""The search spaces of `sympol tune`: the paper's grids (appendix, "HPO Grids"), as fields of our config.

The values of a field are declared with the field (`KNOBS[name].search`); here stands which fields are searched. The
paper's names and ours:

| paper | here |
|---|---|
| `learning_rate_actor_split_idx_array` | `learning_rate_feature_logits` |
| `learning_rate_actor_split_values` | `learning_rate_thresholds` |
| `learning_rate_actor_leaf_array` | `learning_rate_leaf_values` |
| `learning_rate_actor_log_std` | `learning_rate_log_std` |
| `n_update_epochs`, `n_steps`, `n_envs` | `num_epochs`, `num_steps`, `num_envs` |
| `num_layers`, `neurons_per_layer` | `hidden_layers`, `hidden_width`: of `actor_hidden` and `critic_hidden` |
| `max_grad_norm` None | inf |

Differences from the paper:

- `learning_rate_actor_weights` weighs the trees of an ensemble; ours is one tree.
- SYMPOL's `n_update_epochs` is given as 0 to 10. With 0 nothing is learnt, so ours begins at 1, like the
  baselines'.
- `SWA` (averaged weights) does not exist here, because the best validated tree is returned. `adamW` is `weight_decay`,
  which stays as in the preset; the paper does not give its strength.
- Learning rates are drawn on a logarithmic scale. The paper gives only their ends.
- `learning_rate_log_std` is searched for trees with continuous actions only: with discrete ones it does nothing, and
  the baselines' grids do not have it.
- A2C has no epochs and no minibatches. It may also use rollouts of 16 steps, because each rollout gives only one
  update, and with 128 steps or more there are too few of them.

All other fields stay as in the preset that a search starts from.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TypeAlias

from ..algorithms.config import KNOBS, applies
from ..algorithms.knobs import Range

if TYPE_CHECKING:
    from optuna import Trial

Space: TypeAlias = Mapping[str, Range | tuple[Any, ...]]
"""A range or a tuple of values for each name: a field of `Config`, `hidden_width` or `hidden_layers`."""

_HIDDEN: Space = {"hidden_width": Range(16, 256), "hidden_layers": Range(1, 3)}
"""The hidden layers of an MLP's actor and critic. These two are no fields of `Config` by themselves."""
_SHARED = (
    *("learning_rate_critic", "num_epochs", "num_steps", "num_envs", "norm_adv", "ent_coef", "gae_lambda"),
    *("gamma", "vf_coef"),
)
_BASELINES = ("learning_rate_actor", "minibatch_size", "max_grad_norm")
_SEARCHED = {
    "tree": (
        *("learning_rate_feature_logits", "learning_rate_thresholds", "learning_rate_leaf_values"),
        *("learning_rate_log_std", "reduce_lr"),
    ),
    "mlp": _BASELINES,
    "sdt": ("critic", "depth", "temperature", *_BASELINES),
}
"""The fields that the paper searches for each policy, besides `_SHARED`."""
_FIXED: Mapping[str, Mapping[str, Any]] = {
    "tree": {"depth": 7, "minibatch_size": 64, "max_grad_norm": math.inf},
    "mlp": {},
    "sdt": {},
}


def space_of(algorithm: str, policy: str, *, continuous: bool) -> Space:
    """Return the search space of a policy.

    Args:
        algorithm: As in ``Config.algorithm``.
        policy: As in ``Config.policy``.
        continuous: Whether actions are continuous.

    Returns:
        The search space of each field.
    """
    space: dict[str, Range | tuple[Any, ...]] = dict(_HIDDEN) if policy == "mlp" else {}
    for name in (*_SEARCHED[policy], *_SHARED):
        search = KNOBS[name].search
        assert search is not None, f"{name} has no search space"
        if applies(name, algorithm, policy) and (continuous or name != "learning_rate_log_std"):
            space[name] = search
    return {**space, "num_steps": (16, 128, 512)} if algorithm == "a2c" else space


def fixed(algorithm: str, policy: str) -> dict[str, Any]:
    """Return the fields for which the paper's grid has a single value."""
    return {name: value for name, value in _FIXED[policy].items() if applies(name, algorithm, policy)}


def suggest(trial: Trial, space: Space) -> dict[str, Any]:
    """Let Optuna choose the value of every name in a space.

    Args:
        trial: The trial, whose sampler chooses.
        space: The space.

    Returns:
        The values by name; `fields_of` turns them into fields of `Config`.
    """
    return {name: _suggest(trial, name, values) for name, values in space.items()}


def _suggest(trial: Trial, name: str, values: Range | tuple[Any, ...]) -> Any:
    match values:
        case Range(int(low), int(high), log):
            return trial.suggest_int(name, low, high, log=log)
        case Range(low, high, log):
            return trial.suggest_float(name, low, high, log=log)
        case _:
            return trial.suggest_categorical(name, values)


def corner(space: Space, end: int) -> dict[str, Any]:
    """Return the first value of every name of a space (``end`` 0), or the last (``end`` -1)."""
    return {
        name: ((values.low, values.high) if isinstance(values, Range) else values)[end]
        for name, values in space.items()
    }


def fields_of(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return a trial's parameters as fields of `Config`. An MLP's critic has the shape of its actor, as the paper's."""
    fields = {name: value for name, value in params.items() if name not in _HIDDEN}
    if "hidden_width" in params:
        hidden = (params["hidden_width"],) * params.get("hidden_layers", 2)
        fields |= {"actor_hidden": hidden, "critic_hidden": hidden}
    return fields


def to_json(space: Space) -> dict[str, Any]:
    """Return a space in a form that JSON can hold."""
    return {
        name: asdict(values) if isinstance(values, Range) else list(values) for name, values in space.items()
    }


def from_json(space: Mapping[str, Any]) -> Space:
    """Return the space of a form from `to_json`."""
    return {
        name: Range(**values) if isinstance(values, dict) else tuple(values) for name, values in space.items()
    }
