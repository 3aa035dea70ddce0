"""Growing a tree: the split of a plain loop, the same outputs before and after, nothing grown out of noise."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.algorithms import split_growth
from sympol.algorithms.config import Config, ConfigError
from sympol.algorithms.recipe import recipe
from sympol.algorithms.split_growth import FEWEST, closed, output_gradients
from sympol.algorithms.warm_start import Start
from sympol.envs.registry import resolve
from sympol.policies.distributions import Categorical, DiagonalGaussian
from sympol.policies.tree import MASKED, FixedSplits, Tree
from sympol.search.size_limit import extract_unmasked
from sympol.trees.actions import DiscreteActions
from tests.tiny import TINY

BATCH, FEATURES = 512, 3
grow = jax.jit(split_growth.grow, static_argnums=4)


def outputs_of(tree: Tree, x: np.ndarray) -> np.ndarray:
    return np.asarray(jax.jit(lambda tree, x: tree.rollout()(x))(tree, x))


def leaf_tree(depth: int = 3, outputs: int = 2) -> Tree:
    return closed(Tree.create(jax.random.key(0), depth=depth, num_features=FEATURES, num_outputs=outputs))


def observations(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(BATCH, FEATURES)).astype(np.float32)


def extracted(tree: Tree):
    shift, scale = np.zeros(FEATURES, np.float32), np.ones(FEATURES, np.float32)
    return extract_unmasked(tree, shift, scale, actions=DiscreteActions(2))


def step_gradients(x: np.ndarray, feature: int, at: float, seed: int = 1) -> np.ndarray:
    """Gradients whose sign changes at a threshold, with noise."""
    noise = np.random.default_rng(seed).normal(size=(len(x), 2)).astype(np.float32)
    side = np.where(x[:, feature] > at, 1, -1)[:, None] * np.array([1, -1])
    return (side + 0.5 * noise).astype(np.float32)


def best_split_of_a_loop(x: np.ndarray, g: np.ndarray) -> tuple[int, float]:
    """The feature and the sample with the largest reduction of the squared error, of all samples."""
    best = (-np.inf, 0, 0.0)
    variance = (g**2).mean(axis=0)
    for feature in range(x.shape[1]):
        for level in x[:, feature]:
            left = x[:, feature] <= level
            if min(left.sum(), (~left).sum()) < FEWEST:
                continue
            gain = (
                g[left].sum(0) ** 2 / left.sum()
                + g[~left].sum(0) ** 2 / (~left).sum()
                - g.sum(0) ** 2 / len(g)
            )
            best = max(best, (float((gain / variance).sum()), feature, float(level)))
    return best[1], best[2]


def test_a_closed_tree_is_one_leaf():
    tree = leaf_tree()
    assert extracted(tree).n_nodes == 1
    assert (outputs_of(tree, observations()) == np.asarray(tree.leaf_values[0])).all()


@pytest.mark.parametrize(("feature", "at"), [(0, 0.3), (2, -0.7)])
def test_the_first_split_is_that_of_a_plain_loop(feature, at):
    x = observations()
    g = step_gradients(x, feature, at)
    tree = extracted(grow(leaf_tree(), x, g, BATCH, 8))
    loop_feature, level = best_split_of_a_loop(x, g)
    assert tree.feature[0] == loop_feature == feature
    spacing = 2 / 32  # a quantile apart, near the middle of the distribution
    assert tree.threshold[0] == pytest.approx(level, abs=2 * spacing)


def test_growing_changes_no_output_and_one_level_at_a_time():
    tree, x = leaf_tree(), observations()
    for seed, nodes in ((1, 3), (2, 7)):
        before = outputs_of(tree, x)
        g = step_gradients(x, 0, 0.3, seed) * np.where(x[:, 1:2] > 0, 1, -1).astype(np.float32) ** (seed - 1)
        if seed == 2:
            g = step_gradients(x, 1, 0.1, seed)
        tree = grow(tree, x, g, BATCH, 8)
        assert (outputs_of(tree, x) == before).all()
        assert extracted(tree).n_nodes == nodes


def test_nothing_grows_out_of_noise():
    grown = 0
    for seed in range(40):
        g = np.random.default_rng(seed + 100).normal(size=(BATCH, 2)).astype(np.float32)
        grown += extracted(grow(leaf_tree(), observations(seed), g, BATCH, 8)).n_nodes > 1
    assert grown <= 4  # CHANCE is 5 %, and its bound is not tight


def test_gradients_of_zero_grow_nothing():
    grown = grow(leaf_tree(), observations(), np.zeros((BATCH, 2), np.float32), BATCH, 8)
    assert extracted(grown).n_nodes == 1


def test_samples_that_do_not_count_decide_nothing():
    x = observations()
    g = step_gradients(x, 0, 0.0)
    half = BATCH // 2
    other = x.copy()
    other[half:] = 17.0
    of_half = grow(leaf_tree(), other, g, half, 8)
    feature, level = best_split_of_a_loop(x[:half], g[:half])
    tree = extracted(of_half)
    assert tree.feature[0] == feature == 0
    assert tree.threshold[0] == pytest.approx(level, abs=0.3)


def test_no_side_of_a_split_is_smaller_than_allowed():
    x = observations()
    g = np.zeros((BATCH, 2), np.float32)
    g[np.argsort(x[:, 0])[-(FEWEST - 1) :]] = 100  # so few that they may not be split off
    tree = extracted(grow(leaf_tree(), x, g, BATCH, 8))
    if tree.n_nodes > 1:
        right = (x[:, tree.feature[0]] > tree.threshold[0]).sum()
        assert FEWEST <= right <= BATCH - FEWEST


def test_the_number_of_leaves_is_limited():
    tree, x = leaf_tree(depth=4), observations()
    for seed in range(1, 8):
        g = step_gradients(x, seed % FEATURES, 0.1 * seed - 0.4, seed)
        tree = grow(tree, x, g, BATCH, 5)
        assert extracted(tree).n_leaves <= 5
    assert extracted(tree).n_leaves == 5


def test_a_split_lies_between_the_values_of_a_one_hot_feature():
    x = np.zeros((BATCH, FEATURES), np.float32)
    x[: 2 * FEWEST, 1] = 1
    tree = extracted(grow(leaf_tree(), x, step_gradients(x, 1, 0.5), BATCH, 8))
    assert (tree.feature[0], tree.threshold[0]) == (1, 0.5)


@pytest.mark.parametrize("distribution", [Categorical(2), DiagonalGaussian((-1.0,) * 2, (1.0,) * 2, (2,))])
def test_output_gradients_are_those_of_the_objective(distribution):
    rng = np.random.default_rng(0)
    std = 0 if isinstance(distribution, Categorical) else 2
    tree = Tree.create(
        jax.random.key(1), depth=2, num_features=FEATURES, num_outputs=2, num_std=std, log_std=-0.4
    )
    x, advantage = observations(), rng.normal(size=BATCH).astype(np.float32)
    outputs = jnp.asarray(outputs_of(tree, x))
    noise = distribution.noise(jax.random.key(2), (BATCH,))
    action = distribution.sample(outputs, tree.log_std, noise)
    got = jax.jit(output_gradients, static_argnums=0)(distribution, tree, x, action, advantage)

    def objective(outputs):
        return jnp.sum(advantage * distribution.log_prob(outputs, tree.log_std, action))

    np.testing.assert_allclose(got, jax.grad(objective)(outputs), rtol=1e-5, atol=1e-6)


def test_a_closed_node_learns_nothing():
    tree = leaf_tree()

    def loss(tree: Tree, x):
        return jnp.sum(tree(x) ** 2)

    gradient = jax.jit(jax.grad(loss))(tree, observations())
    assert not np.asarray(gradient.thresholds).any()
    assert not np.asarray(gradient.feature_logits).any()
    assert not np.asarray(gradient.leaf_values[1:]).any()
    assert (tree.thresholds == MASKED).all()


def test_training_grows_a_tree_within_its_limit_and_the_tree_read_out_is_the_policy():
    config = {**TINY, "grow_splits": True, "depth": 4, "num_steps": 512, "total_timesteps": 16_384}
    free = sympol.PPO("tree", "CartPole-v1", **config).learn(progress_bar=False)
    agent = sympol.PPO("tree", "CartPole-v1", max_nodes=5, **config).learn(progress_bar=False)
    tree = agent.tree(prune=False)
    assert 1 < tree.n_nodes <= 5 < free.tree(prune=False).n_nodes
    x = np.random.default_rng(0).normal(size=(500, tree.n_features)).astype(np.float32)
    actor, normalizer = agent.state.validation.best_actor, agent.state.normalizer
    outputs = outputs_of(actor, np.asarray(normalizer(jnp.asarray(x))))
    assert (np.argmax(outputs, axis=1) == tree.predict(x)).all()


def test_pruning_by_price_and_growth_exclude_each_other():
    with pytest.raises(ConfigError, match="grow_splits must be False with a node_price"):
        Config(grow_splits=True, node_price=1.0)


def test_the_gradient_of_leaves_is_that_of_the_whole_tree():
    tree = Tree.create(jax.random.key(1), depth=3, num_features=FEATURES, num_outputs=2)
    x = jnp.asarray(observations())
    weights = np.random.default_rng(2).normal(size=(BATCH, 2)).astype(np.float32)

    def of_whole(tree: Tree) -> jax.Array:
        return jnp.sum(tree(x) * weights)

    def of_leaves(values: jax.Array) -> jax.Array:
        return jnp.sum(FixedSplits(tree.rollout()._replace(leaf_values=values), tree.log_std)(x) * weights)

    expected = jax.jit(jax.grad(of_whole))(tree).leaf_values
    np.testing.assert_allclose(jax.jit(jax.grad(of_leaves))(tree.leaf_values), expected, rtol=1e-5)


def test_a_tree_with_frozen_nodes_does_not_grow():
    with pytest.raises(ConfigError, match="grow_splits must be False"):
        Start(extracted(leaf_tree()), freeze=(0,)).check(Config(grow_splits=True))


def test_a_training_that_starts_from_a_tree_has_no_other_nodes_at_first():
    spec = resolve("CartPole-v1")
    names = {"actions": spec.actions, **spec.features.metadata()}
    start = sympol.DecisionTree.from_complete(np.array([2]), np.array([0.0]), np.eye(2), **names)
    sizes = []
    agent = sympol.PPO("tree", "CartPole-v1", start=start, **{**TINY, "grow_splits": True})
    agent.learn(
        progress_bar=False, callback=lambda report: sizes.append(report.agent.tree(prune=False).n_nodes)
    )
    assert sizes[0] == 3
    assert 3 < max(sizes) <= 15


@pytest.mark.parametrize("steps", [10_000, 50_000, 200_000, 1_000_000, 10_000_000])
def test_the_recipe_follows_the_budget(steps):
    config = Config.from_dict({**recipe({"total_timesteps": steps}), "total_timesteps": steps})
    assert 512 <= config.chunk_size <= 4096
    assert steps / config.chunk_size >= 15
    assert 5 <= config.num_evals <= 20
    assert config.grow_splits


def test_the_recipe_follows_what_the_user_chose():
    one = Config.from_dict({**recipe({"num_envs": 1, "total_timesteps": 100_000}), "num_envs": 1})
    assert one.chunk_size == 1024
    assert recipe({"num_eval_episodes": 7})["eval_share"] == 0
    assert recipe({})["eval_share"] > 0
    assert not recipe({"node_price": 1.0}).get("grow_splits", False)
    assert not recipe({}, from_tree=True).get("grow_splits", False)


def interrupt(report: object) -> None:
    raise KeyboardInterrupt


def test_the_budget_of_learn_sets_the_defaults():
    agent = sympol.PPO("tree", "CartPole-v1", env_kwargs={"render_mode": None})
    before = agent.config
    with pytest.raises(KeyboardInterrupt):
        agent.learn(20_000, interrupt, progress_bar=False)
    assert agent.config.total_timesteps == 20_000
    assert agent.config.chunk_size < before.chunk_size
