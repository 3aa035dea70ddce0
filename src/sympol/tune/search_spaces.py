"""What a search for hyperparameters draws from: the paper's grids ("HPO Grids", appendix), as fields of our config.

The paper's names and ours:

| paper | here |
|---|---|
| `learning_rate_actor_split_idx_array` | `learning_rate_feature_logits` |
| `learning_rate_actor_split_values` | `learning_rate_thresholds` |
| `learning_rate_actor_leaf_array` | `learning_rate_leaf_values` |
| `learning_rate_actor_log_std` | `learning_rate_log_std` |
| `n_update_epochs`, `n_steps`, `n_envs` | `num_epochs`, `num_steps`, `num_envs` |
| `num_layers`, `neurons_per_layer` | `hidden_layers`, `hidden_width`: of `actor_hidden` and `critic_hidden` |
| `max_grad_norm` None | inf |

What differs:

- `learning_rate_actor_weights` weighs the trees of an ensemble; ours is one tree.
- SYMPOL's `n_update_epochs` is given as 0 to 10. With 0 nothing is learnt: ours begin at 1, as those of its
  rivals do.
- `SWA` (averaged weights) does not exist here: the best validated tree is returned. `adamW` is `weight_decay`, which
  stays as in the preset; the paper does not give its strength.
- Learning rates are drawn on a logarithmic scale. The paper gives their ends only.
- `learning_rate_log_std` is searched for trees with continuous actions only: with discrete ones it does nothing, and
  the rivals' grids have none.
- A2C has no epochs and no minibatches. It may also take rollouts of 16 steps: each brings one
  update only, and with 128 and more there are too few of them.

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
"""By name a range, or a tuple of values to choose from. A name is a field of `Config`, `hidden_width` or
`hidden_layers`."""

_HIDDEN: Space = {"hidden_width": Range(16, 256), "hidden_layers": Range(1, 3)}
"""The width and the number of the hidden layers of an MLP's actor and critic, which are no fields by themselves."""
_ALL = (
    *("learning_rate_critic", "num_epochs", "num_steps", "num_envs", "norm_adv", "ent_coef", "gae_lambda"),
    *("gamma", "vf_coef"),
)
_BASELINES = ("learning_rate_actor", "minibatch_size", "max_grad_norm")
_OF = {
    "tree": (
        *("learning_rate_feature_logits", "learning_rate_thresholds", "learning_rate_leaf_values"),
        *("learning_rate_log_std", "reduce_lr"),
    ),
    "mlp": _BASELINES,
    "sdt": ("critic", "depth", "temperature", *_BASELINES),
}
"""The fields that the paper searches for each policy; what they may be stands where they are declared."""
_FIXED: Mapping[str, Mapping[str, Any]] = {
    "tree": {"depth": 7, "minibatch_size": 64, "max_grad_norm": math.inf},
    "mlp": {},
    "sdt": {},
}


def space_of(algorithm: str, policy: str, *, continuous: bool) -> Space:
    """Return what is searched for a policy.

    Args:
        algorithm: As in ``Config.algorithm``.
        policy: As in ``Config.policy``.
        continuous: Whether actions are continuous.

    Returns:
        The search space of each field.
    """
    space: dict[str, Range | tuple[Any, ...]] = dict(_HIDDEN) if policy == "mlp" else {}
    for name in (*_OF[policy], *_ALL):
        search = KNOBS[name].search
        assert search is not None, f"{name} has no search space"
        if applies(name, algorithm, policy) and (continuous or name != "learning_rate_log_std"):
            space[name] = search
    return {**space, "num_steps": (16, 128, 512)} if algorithm == "a2c" else space


def fixed(algorithm: str, policy: str) -> dict[str, Any]:
    """Return the fields of which a grid has one value only."""
    return {name: value for name, value in _FIXED[policy].items() if applies(name, algorithm, policy)}


def drawn(trial: Trial, space: Space) -> dict[str, Any]:
    """What a trial is to try."""
    return {name: _draw(trial, name, values) for name, values in space.items()}


def _draw(trial: Trial, name: str, values: Range | tuple[Any, ...]) -> Any:
    match values:
        case Range(int(low), int(high), log):
            return trial.suggest_int(name, low, high, log=log)
        case Range(low, high, log):
            return trial.suggest_float(name, low, high, log=log)
        case _:
            return trial.suggest_categorical(name, values)


def corner(space: Space, end: int) -> dict[str, Any]:
    """The first (0) or the last (-1) value of everything."""
    return {
        name: ((values.low, values.high) if isinstance(values, Range) else values)[end]
        for name, values in space.items()
    }


def fields_of(params: Mapping[str, Any]) -> dict[str, Any]:
    """What was drawn, as fields of `Config`. An MLP's critic is a network like its actor, as the paper's is."""
    fields = {name: value for name, value in params.items() if name not in _HIDDEN}
    if "hidden_width" in params:
        hidden = (params["hidden_width"],) * params.get("hidden_layers", 2)
        fields |= {"actor_hidden": hidden, "critic_hidden": hidden}
    return fields


def to_json(space: Space) -> dict[str, Any]:
    """A space as JSON can hold it."""
    return {
        name: asdict(values) if isinstance(values, Range) else list(values) for name, values in space.items()
    }


def from_json(space: Mapping[str, Any]) -> Space:
    """The same back."""
    return {
        name: Range(**values) if isinstance(values, dict) else tuple(values) for name, values in space.items()
    }
