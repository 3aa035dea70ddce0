"""Training within a limit of size: `Config.max_nodes` and `Config.node_price`.

The first half of a training is free, or the first quarter where rollouts grow. At the validation after it (`moment`)
the best tree so far is pruned by what it earns (`prune_by_return`), and the training continues in that shape: with the
same critic, optimiser and compiled program, and with a validation that only knows trees of this shape. A tree that
is requested before that moment is pruned by the same rule when it is requested.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from ..algorithms.config import Config
from ..algorithms.state import TrainState
from ..algorithms.trainer import stops
from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from .evaluators import make_evaluator
from .masking import mask_nodes
from .prune_by_return import prune_by_return

FREE, FREE_GROWING = 0.5, 0.25
"""The part of a training before the limit is imposed. Where rollouts and batches grow (`Config.dynamic_rollout`), most
updates come early: after half of the steps too few would be left to make up for what pruning cost."""


def has_limit(config: Config) -> bool:
    """Return True where a training has a limit of size."""
    return config.max_nodes > 0 or config.node_price > 0


def prune_step(config: Config) -> int:
    """The timestep after which the tree is within the limit, at the first validation from it on."""
    free = FREE_GROWING if config.dynamic_rollout else FREE
    return next(stop for stop in stops(config) if stop >= free * config.total_timesteps)


def is_due(config: Config, before: int, now: int) -> bool:
    """Return True where pruning is due between the timesteps ``before`` and ``now``."""
    return has_limit(config) and before < prune_step(config) <= now


def tree_within_limit(
    tree: DecisionTree, timestep: int, spec: EnvSpec, config: Config, seed: int
) -> DecisionTree:
    """Return the tree of a training at a timestep, pruned by return if the limit is not imposed yet.

    Args:
        tree: The tree.
        timestep: Environment steps of the training so far.
        spec: The environment, in which the episodes of the pruning are played.
        config: The configuration, which may have no limit.
        seed: The seed of those episodes.

    Returns:
        The tree, within the limit.
    """
    is_imposed = not has_limit(config) or timestep >= prune_step(config)
    return tree if is_imposed else prune_within(tree, spec, config, seed)


def prune_within(tree: DecisionTree, spec: EnvSpec, config: Config, seed: int) -> DecisionTree:
    """A tree pruned by what it earns until it is within the config's limit."""
    listed = spec.all_observations()
    tree = tree.prune(observations=listed)
    if not config.node_price and tree.n_nodes <= config.max_nodes:
        return tree
    return prune_by_return(
        tree,
        make_evaluator(spec, seed),
        max_nodes=config.max_nodes or None,
        node_price=config.node_price,
        observations=listed,
    ).tree


def mask_state(state: TrainState, full: DecisionTree, spec: EnvSpec, config: Config, seed: int) -> TrainState:
    """Return the state that continues with the best tree so far, pruned; nothing of it is validated yet.

    ``full`` is that tree, extracted as a whole. Learning rates that were halved are whole again: there is a new tree
    to improve.
    """
    best: Any = state.validation.best_actor if config.select_best else state.networks.actor
    small = prune_within(full, spec, config, seed)
    spare = 0 if config.node_price else max(0, config.max_nodes - small.n_nodes) // 2
    shift, scale = (np.asarray(part) for part in state.normalizer)
    actor = mask_nodes(best, shift, scale, small, spare)
    validation = state.validation._replace(
        best_return=jnp.float32(-jnp.inf),
        best_actor=actor,
        num_bad=jnp.int32(0),
        lr_factor=jnp.float32(1),
    )
    return state._replace(networks=state.networks._replace(actor=actor), validation=validation)
