"""The soft tree against the formula it stands for: a sum over leaves, each with the product of the gates to it."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from sympol.policies.soft_tree import SoftTree
from tests.functional.oracle import entmax15_sorted
from tests.functional.test_entmax import sorted_in_float64

FEATURES, OUTPUTS, BATCH = 3, 2, 16
PARAMETERS = ("feature_logits", "thresholds", "leaf_values")
DEPTHS = pytest.mark.parametrize("depth", [1, 2, 3, 5])
outputs = jax.jit(SoftTree.__call__)
reach = jax.jit(SoftTree.reach)


def tree_of(depth: int, temperature: float = 1.0) -> SoftTree:
    """With thresholds and leaves as a trained one may have, so that gates are open, half open and shut."""
    rng, nodes = np.random.default_rng(depth), 2**depth - 1
    shapes = [(nodes, FEATURES), (nodes,), (nodes + 1, OUTPUTS), (0,)]
    parameters = [jnp.asarray(rng.normal(size=shape), jnp.float32) for shape in shapes]
    return SoftTree(*parameters, temperature=temperature)


def observations(n: int = BATCH) -> np.ndarray:
    return (1.5 * np.random.default_rng(n).normal(size=(n, FEATURES))).astype(np.float32)


def ways(tree: SoftTree, x: np.ndarray) -> np.ndarray:
    """The weight of each leaf, one observation and one leaf at a time, from the leaf up to the root."""
    num_leaves = len(tree.leaf_values)
    weights = sorted_in_float64(np.asarray(tree.feature_logits))
    reach = np.ones((len(x), num_leaves))
    for i, observation in enumerate(x):
        for leaf in range(num_leaves):
            node = num_leaves + leaf  # counting nodes from one, parents are halves
            while node > 1:
                parent = node // 2
                seen = sum(weights[parent - 1, f] * float(observation[f]) for f in range(FEATURES))
                margin = (float(tree.thresholds[parent - 1]) - seen) / tree.temperature
                left, right = sorted_in_float64(np.array([margin, 0.0]))
                reach[i, leaf] *= left if node % 2 == 0 else right
                node = parent
    return reach


@pytest.mark.parametrize(("depth", "temperature"), [(1, 1.0), (2, 0.3), (3, 2.5), (5, 1.0)])
def test_outputs_are_the_leaves_weighted_by_the_gates_to_them(depth, temperature):
    tree, x = tree_of(depth, temperature), observations()
    expected = ways(tree, x)
    np.testing.assert_allclose(reach(tree, x), expected, atol=2e-6, rtol=0)
    np.testing.assert_allclose(
        outputs(tree, x), expected @ np.asarray(tree.leaf_values, np.float64), atol=1e-5, rtol=0
    )
    assert ((expected > 0) & (expected < 1)).any()  # neither all open


@DEPTHS
def test_the_ways_of_an_observation_sum_to_one(depth):
    tree = tree_of(depth)
    x = np.concatenate([observations(500), np.float32([[1e6] * 3, [-1e6] * 3, [0.0] * 3])])
    found = np.asarray(reach(tree, x), np.float64)
    np.testing.assert_allclose(found.sum(1), 1, atol=1e-6)
    assert (found >= 0).all()
    same = dataclasses.replace(tree, leaf_values=jnp.full_like(tree.leaf_values, 0.7))
    np.testing.assert_allclose(outputs(same, x), 0.7, rtol=1e-5)  # wherever one goes


def test_the_weights_of_a_node_sum_to_one():
    weights = np.asarray(tree_of(5).weights)
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    assert (weights == 0).any()  # and are sparse


@DEPTHS
def test_in_the_cold_it_routes_hard(depth):
    """Left where w·x lies below the threshold, by the nodes' order: the children of i are 2i + 1 and 2i + 2."""
    tree, x = tree_of(depth, temperature=1e-6), observations(200)
    weights, thresholds = sorted_in_float64(np.asarray(tree.feature_logits)), np.asarray(tree.thresholds)
    leaves = []
    for observation in x.astype(np.float64):
        node = 0
        while node < len(thresholds):
            margin = thresholds[node] - weights[node] @ observation
            assert abs(margin) > 1e-5  # nothing lies on the fence here
            node = 2 * node + (1 if margin > 0 else 2)
        leaves.append(node - len(thresholds))
    assert len({*leaves}) > 1
    expected = np.eye(len(thresholds) + 1)[leaves]
    np.testing.assert_array_equal(reach(tree, x), expected)
    np.testing.assert_allclose(tree(jnp.asarray(x)), np.asarray(tree.leaf_values)[leaves], rtol=1e-6)


def formula(feature_logits: Array, thresholds: Array, leaf_values: Array, x: Array) -> Array:
    """The same sum, for autodiff: entmax15 by sorting twice, products leaf by leaf."""
    num_leaves = len(leaf_values)
    margin = thresholds[None] - x @ entmax15_sorted(feature_logits).T
    left = entmax15_sorted(jnp.stack([margin, jnp.zeros_like(margin)], axis=-1))[..., 0]
    total = jnp.zeros((x.shape[0], leaf_values.shape[1]), x.dtype)
    for leaf in range(num_leaves):
        node, way = num_leaves + leaf, jnp.ones(x.shape[0], x.dtype)
        while node > 1:
            gate = left[:, node // 2 - 1]
            way = way * (gate if node % 2 == 0 else 1 - gate)
            node //= 2
        total = total + way[:, None] * leaf_values[leaf][None]
    return total


@pytest.mark.parametrize("depth", [1, 3])
def test_gradient_equals_autodiff_of_the_sum_in_float64(depth):
    """Of the parameters, and of the observations."""
    tree, x = tree_of(depth), observations(64)
    v = np.random.default_rng(1).normal(size=(64, OUTPUTS))
    arguments = [np.asarray(getattr(tree, name), np.float64) for name in PARAMETERS]
    with jax.enable_x64(True):
        slopes = jax.jit(lambda *a: jax.vjp(formula, *a)[1](jnp.asarray(v)))
        *expected, expected_x = slopes(*arguments, x.astype(np.float64))
    pullback = jax.jit(lambda tree, x, v: jax.vjp(lambda t, x: t(x), tree, x)[1](v))
    gradient, of_x = pullback(tree, x, v.astype(np.float32))
    for name, theirs in zip(PARAMETERS, expected, strict=True):
        assert np.any(theirs), name
        np.testing.assert_allclose(getattr(gradient, name), theirs, atol=1e-4, rtol=1e-4, err_msg=name)
    np.testing.assert_allclose(of_x, expected_x, atol=1e-5, rtol=1e-4)


def test_far_from_every_threshold_only_a_leaf_learns():
    tree = tree_of(3)
    gradient = jax.jit(jax.grad(lambda t: jnp.sum(t(jnp.full((1, FEATURES), 1e4)))))(tree)
    assert not np.any(gradient.feature_logits)
    assert not np.any(gradient.thresholds)
    assert sorted(np.asarray(gradient.leaf_values).sum(1)) == [0] * 7 + [OUTPUTS]


def test_on_its_threshold_an_observation_s_ways_are_equal():
    tree = dataclasses.replace(tree_of(1), thresholds=jnp.zeros(1))
    np.testing.assert_allclose(reach(tree, np.zeros((1, FEATURES), np.float32)), [[0.5, 0.5]], rtol=1e-7)


def test_it_acts_as_it_learns():
    tree, x = tree_of(3), observations()
    np.testing.assert_array_equal(outputs(tree.rollout(), x), outputs(tree, x))


def test_a_soft_tree_begins_random_and_nearly_indifferent():
    one, other = (
        SoftTree.create(
            jax.random.key(s),
            depth=4,
            num_features=3,
            num_outputs=2,
            num_std=2,
            log_std=-0.5,
            temperature=0.2,
        )
        for s in range(2)
    )
    assert one.feature_logits.shape == (15, 3)
    assert one.thresholds.shape == (15,)
    assert one.leaf_values.shape == (16, 2)
    assert one.temperature == 0.2
    np.testing.assert_array_equal(one.log_std, np.float32([-0.5, -0.5]))
    assert np.abs(outputs(one, observations(200))).max() < 0.5
    for name in PARAMETERS:
        assert not np.any(np.asarray(getattr(one, name)) == np.asarray(getattr(other, name)))
