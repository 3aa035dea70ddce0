"""Policy = extracted tree, action for action, on a million observations that try to tell them apart."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.state import Normalizer
from sympol.envs.spaces import action_spec
from sympol.policies.distributions import distribution_of
from sympol.policies.extract import extract_tree
from sympol.policies.tree import Tree
from sympol.trees import DecisionTree

SPACES = {
    "discrete": gymnasium.spaces.Discrete(4),
    "box": gymnasium.spaces.Box(np.float32([[-1, -0.5]]), np.float32([[1, 0.5]]), (1, 2), np.float32),
    "multi_discrete": gymnasium.spaces.MultiDiscrete([2, 3]),
}
SPECIAL = np.float32([0, -0.0, 1e-45, -1e-45, 1e-39, -1e-39, 1.1754944e-38, -1.1754944e-38, 3.4e38, -3.4e38])
ODD = np.float32([np.inf, -np.inf, np.nan])
NUM_FEATURES, NUM_POLICIES, BATCH = 4, 5, 200_000


def random_policy(
    space: gymnasium.Space, seed: int, temperature: float = 1.0
) -> tuple[Tree, Normalizer, DecisionTree]:
    rng = np.random.default_rng(seed)
    distribution = distribution_of(space)
    actor = Tree.create(
        jax.random.key(seed),
        depth=5,
        num_features=NUM_FEATURES,
        num_outputs=distribution.num_outputs,
        num_std=distribution.num_std,
        temperature=temperature,
    )
    # leaves far enough apart to act differently, with ties among them
    values = np.round(2 * rng.normal(size=actor.leaf_values.shape)).astype(np.float32) / 2
    actor = eqx.tree_at(lambda tree: tree.leaf_values, actor, jnp.asarray(values))
    shift = rng.normal(size=NUM_FEATURES).astype(np.float32) * np.float32([0, 1, 10, 1000])
    scale = np.exp(2 * rng.normal(size=NUM_FEATURES)).astype(np.float32)
    tree = extract_tree(
        actor,
        shift,
        scale,
        actions=action_spec(space),
        feature_names=[f"x{i}" for i in range(NUM_FEATURES)],
        feature_low=np.full(NUM_FEATURES, -np.inf),
        feature_high=np.full(NUM_FEATURES, np.inf),
    )
    return actor, Normalizer(jnp.asarray(shift), jnp.asarray(scale)), tree


def observations(tree: DecisionTree, normalizer: Normalizer, seed: int) -> np.ndarray:
    """Anywhere in the space the tree divides, exactly on thresholds, one and two floats beside them, special."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(BATCH, NUM_FEATURES)) / np.asarray(normalizer.scale) + np.asarray(normalizer.shift)
    x = x.astype(np.float32)
    for feature in range(NUM_FEATURES):
        t = tree.threshold[(tree.feature == feature) & ~tree.is_leaf]
        up = np.nextafter(t, np.float32(np.inf))
        down = np.nextafter(t, np.float32(-np.inf))
        beside = [t, up, down, np.nextafter(up, np.float32(np.inf)), np.nextafter(down, np.float32(-np.inf))]
        where = rng.random(BATCH) < 0.6
        x[where, feature] = rng.choice(np.concatenate([*beside, SPECIAL, ODD]), where.sum())
    return x


@pytest.mark.parametrize("kind", SPACES)
def test_policy_and_tree_act_alike_on_a_million_observations(kind):
    space = SPACES[kind]
    distribution: Any = distribution_of(space)

    @jax.jit
    def act(actor: Tree, normalizer: Normalizer, x):
        outputs = actor.rollout()(normalizer(x))
        return outputs, distribution.to_env(distribution.mode(outputs)), actor(normalizer(x))

    for seed in range(NUM_POLICIES):
        actor, normalizer, tree = random_policy(space, seed)
        x = observations(tree, normalizer, seed)
        outputs, action, differentiable = act(actor, normalizer, x)
        np.testing.assert_array_equal(tree.predict(x), np.asarray(action))
        np.testing.assert_array_equal(tree.value[tree.apply(x)], np.asarray(outputs))
        np.testing.assert_array_equal(np.asarray(differentiable), np.asarray(outputs))
        assert len(np.unique(tree.apply(x))) > 10  # of 32 leaves, some of which no observation can reach


def test_one_observation_is_the_batch_of_one():
    actor, normalizer, tree = random_policy(SPACES["discrete"], 0)
    x = observations(tree, normalizer, 0)[:50]
    run = jax.jit(lambda x: actor(normalizer(x)))
    together = np.asarray(run(x))
    alone = [np.asarray(run(row[None]))[0] for row in x]
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize("temperature", [2**-10, 0.25, 2**10])
def test_the_temperature_of_the_surrogate_moves_no_decision(temperature):
    """The differentiable tree is the tree that acts, beside its thresholds too, whatever the backward pass does."""
    both = jax.jit(lambda actor, normalizer, x: (actor(normalizer(x)), actor.rollout()(normalizer(x))))
    for seed in range(3):
        actor, normalizer, tree = random_policy(SPACES["discrete"], seed, temperature)
        differentiable, acting = both(actor, normalizer, observations(tree, normalizer, seed))
        np.testing.assert_array_equal(np.asarray(differentiable), np.asarray(acting))
