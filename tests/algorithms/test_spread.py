"""`threshold_init = "visited"`: a training that starts at random, its splits where its observations are."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest

import sympol
from sympol.algorithms.config import Config, ConfigError
from sympol.algorithms.data_init import init_thresholds
from sympol.algorithms.normalization import initial_normalizer
from sympol.algorithms.state import TrainState
from sympol.envs.registry import resolve
from sympol.policies.distributions import distribution_of
from sympol.types import Transition
from tests.algorithms.programs import state_with
from tests.tiny import TINY, quick_compiles

__all__ = ["quick_compiles"]

DEPTH, STEPS, ENVS = 4, 32, 8


HIGH = np.array([4, np.inf, np.inf], np.float32)
SPACE = gymnasium.spaces.Box(-HIGH, HIGH)
"""The first feature is believed to be within ±4; the others have no bounds."""


def observations(rng: np.random.Generator) -> np.ndarray:
    """Raw, far from where random thresholds lie; most of the last feature is the same."""
    x = rng.normal(size=(STEPS, ENVS, 3)) * [0.1, 50, 1] + [3, 1000, -7]
    x[..., 2] = np.where(rng.random((STEPS, ENVS)) < 0.9, -7, x[..., 2])
    return x.astype(np.float32)


def spread_out(seed: int) -> tuple[TrainState, TrainState, np.ndarray]:
    """A state before and after, and the chunk as the tree sees it afterwards."""
    config = Config(depth=DEPTH, trust_bounds=True, threshold_init="visited")
    distribution = distribution_of(resolve("CartPole-v1").action_space)
    scaling = initial_normalizer(SPACE, config)
    state = state_with(config, distribution, scaling[0], seed)
    raw: Any = observations(np.random.default_rng(seed))
    nothing: Any = np.zeros((1, STEPS, ENVS), np.float32)
    chunk = Transition(state.normalizer(raw)[None], *[nothing] * 5)
    after = jax.jit(lambda state: init_thresholds(scaling, state, chunk, jax.random.key(seed)))(state)
    return state, after, np.asarray(after.normalizer(raw.reshape(-1, 3)))


@pytest.mark.parametrize("seed", range(5))
def test_every_node_splits_those_that_come_by_wherever_they_differ(seed: int) -> None:
    _, after, x = spread_out(seed)
    actor: Any = after.networks.actor
    feature = np.argmax(actor.feature_logits, axis=1)
    by = {0: np.arange(len(x))}
    num_split = 0
    for node in range(2**DEPTH - 1):
        mine = x[by[node]]
        if len(mine):  # for whatever feature it may come to look at, the threshold is among what comes by
            assert (mine.min(axis=0) <= actor.thresholds[node]).all()
            assert (actor.thresholds[node] <= mine.max(axis=0)).all()
        left = mine[:, feature[node]] <= actor.thresholds[node, feature[node]]
        by |= {2 * node + 1: by[node][left], 2 * node + 2: by[node][~left]}
        if feature[node] != 2 and len(mine) > 1:
            assert 0 < left.sum() < len(left)
            num_split += 1
    assert num_split > 2


def test_features_and_leaves_are_as_they_were() -> None:
    before, after, _ = spread_out(0)
    for name in ("feature_logits", "leaf_values", "log_std"):
        was, now = (np.asarray(getattr(state.networks.actor, name)) for state in (before, after))
        np.testing.assert_array_equal(was, now)
    jax.tree.map(np.testing.assert_array_equal, after.networks.actor, after.validation.best_actor)


def test_the_scale_is_that_of_a_training_with_normal_thresholds() -> None:
    _, after, x = spread_out(1)
    assert (after.normalizer.shift[0], after.normalizer.scale[0]) == (0, 0.25)
    np.testing.assert_allclose(x[:, 1:].mean(axis=0), 0, atol=1e-3)
    np.testing.assert_allclose(x[:, 1:].std(axis=0), 0.5, atol=1e-3)


def test_a_training_begins_with_it_and_only_if_asked_to() -> None:
    """With rates of 0 the last tree is the first one; on bounded features, too, whose scale needs no chunk."""
    still = {f"learning_rate_{part}": 0.0 for part in ("feature_logits", "thresholds", "leaf_values")}
    values = {**TINY, **still, "weight_decay": 0.0, "trust_bounds": True, "depth": 4}
    angle, velocity = np.random.default_rng(0).uniform([[-np.pi], [-2]], [[np.pi], [2]], (2, 2000))
    x = np.stack([np.cos(angle), np.sin(angle), velocity], axis=1).astype(np.float32)
    leaves = {}
    for init in ("normal", "visited"):
        agent = sympol.PPO("tree", "Pendulum-v1", seed=1000, **{**values, "threshold_init": init})
        tree = agent.learn(progress_bar=False).tree(prune=False)
        leaves[init] = len(np.unique(tree.apply(x)))
    assert leaves["visited"] > leaves["normal"]


def test_it_is_a_trees() -> None:
    with pytest.raises(ConfigError, match="threshold_init"):
        replace(Config(), policy="mlp", threshold_init="visited")
    with pytest.raises(ConfigError, match="threshold_init must be one of normal, visited"):
        Config(threshold_init="median")  # pyright: ignore[reportArgumentType]
