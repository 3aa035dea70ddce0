"""How the networks begin."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from sympol.policies.mlp import MLP, MLPActor
from sympol.policies.tree import Tree


def test_a_tree_begins_random_and_nearly_indifferent():
    trees = [Tree.create(jax.random.key(s), depth=4, num_features=3, num_outputs=2) for s in range(2)]
    assert trees[0].feature_logits.shape == trees[0].thresholds.shape == (15, 3)
    assert trees[0].leaf_values.shape == (16, 2)
    assert trees[0].log_std.shape == (0,)
    assert float(jnp.abs(trees[0].leaf_values).max()) < 0.1
    for a, b in zip(jax.tree.leaves(trees[0])[:3], jax.tree.leaves(trees[1])[:3], strict=True):
        assert not np.any(np.asarray(a) == np.asarray(b))


def test_a_tree_knows_its_noise():
    tree = Tree.create(jax.random.key(0), depth=1, num_features=1, num_outputs=2, num_std=2, log_std=-0.5)
    np.testing.assert_array_equal(tree.log_std, np.float32([-0.5, -0.5]))


def test_the_mlp_is_layers_with_tanh_between():
    mlp = MLP.create(jax.random.key(0), (3, 5, 4, 1))
    x = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)
    h = x.astype(np.float64)
    for weight, bias in zip(mlp.weights[:-1], mlp.biases[:-1], strict=True):
        h = np.tanh(h @ np.asarray(weight, np.float64) + np.asarray(bias))
    expected = h @ np.asarray(mlp.weights[-1], np.float64) + np.asarray(mlp.biases[-1])
    np.testing.assert_allclose(mlp(jnp.asarray(x)), expected, rtol=1e-5, atol=1e-6)
    linear = MLP.create(jax.random.key(0), (3, 1))
    np.testing.assert_allclose(
        linear(jnp.asarray(x)), x @ np.asarray(linear.weights[0]), rtol=1e-5, atol=1e-6
    )


def test_an_mlp_that_acts_is_the_network_and_its_noise():
    key, x = jax.random.key(4), jnp.asarray(np.random.default_rng(0).normal(size=(7, 3)), jnp.float32)
    actor, net = MLPActor.create(key, (3, 5, 2), num_std=2, log_std=-0.5), MLP.create(key, (3, 5, 2))
    np.testing.assert_array_equal(actor.log_std, np.float32([-0.5, -0.5]))
    np.testing.assert_array_equal(actor(x), net(x))
    np.testing.assert_array_equal(actor.rollout()(x), net(x))
    assert MLPActor.create(key, (3, 2)).log_std.shape == (0,)


def test_an_mlp_begins_random_and_nearly_indifferent():
    """Layers of variance 1/inputs keep the size of what goes through; the last is a tenth of that."""
    one, other = (MLPActor.create(jax.random.key(s), (100, 200, 2)).net for s in range(2))
    assert [w.shape for w in one.weights] == [(100, 200), (200, 2)]
    assert [b.shape for b in one.biases] == [(200,), (2,)]
    assert not any(np.any(b) for b in one.biases)
    np.testing.assert_allclose(np.std(one.weights[0]), 1 / np.sqrt(100), rtol=0.05)
    np.testing.assert_allclose(np.std(one.weights[1]), 0.1 / np.sqrt(200), rtol=0.15)
    for a, b in zip(one.weights, other.weights, strict=True):
        assert not np.any(np.asarray(a) == np.asarray(b))
