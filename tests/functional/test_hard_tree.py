from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.functional import hard_tree, leaf_index, select
from tests.functional.oracle import flush, plain_tree, random_tree, textbook_tree

TINY = np.finfo(np.float32).tiny


@pytest.fixture(autouse=True)
def strict():
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        yield


def weights(batch: int, actions: int) -> np.ndarray:
    return np.random.default_rng(99).normal(size=(batch, actions)).astype(np.float32)


def gradients(tree, arrays, w, surrogate):
    """∂ Σ w·tree/∂parameters."""
    *parameters, x = map(jnp.asarray, arrays)

    def loss(parameters):
        return jnp.sum(tree(*parameters, x, surrogate=surrogate) * w)

    return jax.jit(jax.grad(loss))(tuple(parameters))


def textbook_gradients(arrays, w, surrogate):
    with jax.enable_x64(True), jax.numpy_rank_promotion("allow"):
        arrays = [np.asarray(a, np.float64) for a in arrays]
        return [np.asarray(g) for g in gradients(textbook_tree, arrays, w.astype(np.float64), surrogate)]


def assert_close(ours, expected, tolerance=1e-5):
    for name, a, b in zip(("feature_logits", "thresholds", "leaf_values"), ours, expected, strict=True):
        distance, size = np.linalg.norm(np.asarray(a) - b), np.linalg.norm(b)
        assert distance <= tolerance * size + 1e-12, f"{name}: {distance / size:.1e}"


@pytest.mark.parametrize(
    ("depth", "features", "actions", "batch", "surrogate"),
    [
        (1, 1, 1, 1, "sigmoid"),
        (1, 4, 2, 33, "softsign"),
        (2, 3, 5, 7, "sigmoid"),
        (3, 1, 2, 64, "softsign"),
        (4, 8, 3, 16, "sigmoid"),
        (5, 40, 2, 64, "softsign"),
        (6, 147, 4, 32, "sigmoid"),
        (7, 4, 2, 512, "sigmoid"),
        (7, 4, 2, 512, "softsign"),
        (8, 6, 1, 3, "softsign"),
        (9, 8, 2, 32, "sigmoid"),
        (11, 3, 2, 8, "softsign"),
    ],
)
def test_gradients_equal_autodiff_of_the_textbook_product(depth, features, actions, batch, surrogate):
    arrays = random_tree(depth, depth, features, actions, batch)
    w = weights(batch, actions)
    assert_close(gradients(hard_tree, arrays, w, surrogate), textbook_gradients(arrays, w, surrogate))


def test_gradients_with_large_differences_and_equal_logits():
    feature_logits, thresholds, leaf_values, x = random_tree(3, 5, 12, 3, 64)
    arrays = (np.zeros_like(feature_logits), thresholds * 30, leaf_values * 100, x * 30)
    w = weights(64, 3)
    assert_close(gradients(hard_tree, arrays, w, "softsign"), textbook_gradients(arrays, w, "softsign"))


def awkward_tree(seed: int, depth: int, features: int):
    """Logits with ties; thresholds and observations from a few values that meet each other exactly."""
    rng = np.random.default_rng(seed)
    feature_logits, thresholds, leaf_values, x = random_tree(seed, depth, features, 3, 400)
    values = [0, -0.0, 1, -1, TINY, -TINY, TINY / 2, -TINY / 4, 1e-45, -1e-45, 3e38, np.inf, -np.inf]
    x = rng.choice(
        np.array([*values, np.nan, np.nextafter(np.float32(1), np.float32(2))], np.float32), x.shape
    )
    thresholds = rng.choice(np.array(values, np.float32), thresholds.shape)
    return np.round(feature_logits).astype(np.float32), thresholds, leaf_values, x


@pytest.mark.parametrize(("depth", "features"), [(1, 1), (3, 2), (7, 5), (4, 147), (14, 3)])
@pytest.mark.parametrize("make", [awkward_tree, lambda s, d, f: random_tree(s, d, f, 3, 400)])
def test_forward_is_the_plain_tree_to_the_bit(make, depth, features):
    arrays = make(1, depth, features)
    expected = plain_tree(*arrays)
    feature_logits, thresholds, leaf_values, x = map(jnp.asarray, arrays)
    assert np.array_equal(jax.jit(hard_tree)(feature_logits, thresholds, leaf_values, x), expected)
    feature, threshold = jax.jit(select)(feature_logits, thresholds)
    assert feature.dtype == jnp.int32
    assert np.array_equal(feature, np.argmax(arrays[0], 1))
    assert np.array_equal(threshold, flush(arrays[1])[np.arange(len(arrays[1])), np.argmax(arrays[0], 1)])
    leaves = jax.jit(leaf_index)(feature, threshold, x)
    assert leaves.dtype == jnp.int32
    assert np.array_equal(leaf_values[leaves], expected)


def test_observations_that_are_not_numbers_leave_the_gradients_of_the_others_alone():
    feature_logits, thresholds, leaf_values, x = random_tree(2, 5, 3, 2, 64)
    x[::4] = np.array([[np.nan] * 3, [np.inf] * 3, [-np.inf] * 3, [np.nan, np.inf, -np.inf]] * 4, np.float32)
    good = np.isfinite(x).all(1)
    w = weights(64, 2)
    arrays = (feature_logits, thresholds, leaf_values)
    ours = gradients(hard_tree, (*arrays, x), w, "sigmoid")
    rest = gradients(hard_tree, (*arrays, x[good]), w[good], "sigmoid")
    assert all(np.isfinite(g).all() for g in ours)
    for a, b in zip(ours[:2], rest[:2], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)


def test_one_missing_feature_counts_as_nothing_where_it_is_looked_at():
    arrays = random_tree(5, 1, 2, 1, 1)
    arrays[0][:] = [[1, 0]]
    arrays[3][:] = [[np.nan, 2]]
    logits, thresholds, _ = gradients(hard_tree, arrays, np.ones((1, 1), np.float32), "sigmoid")
    assert not np.any(logits)
    assert not np.any(thresholds)


def test_infinite_thresholds_pad_a_smaller_tree():
    feature_logits, thresholds, leaf_values, x = random_tree(4, 3, 2, 2, 32)
    thresholds[3:] = np.inf
    values = np.repeat(leaf_values[::2], 2, axis=0)
    padded = gradients(hard_tree, (feature_logits, thresholds, values, x), weights(32, 2), "sigmoid")
    small = gradients(
        hard_tree, (feature_logits[:3], thresholds[:3], leaf_values[::2], x), weights(32, 2), "sigmoid"
    )
    for a, b in zip(padded[:2], small[:2], strict=True):
        np.testing.assert_allclose(a[:3], b, rtol=1e-5, atol=1e-7)
        assert not np.any(a[3:])


def test_only_the_chosen_threshold_has_a_gradient():
    arrays = random_tree(6, 6, 9, 3, 256)
    _, gradient, _ = gradients(hard_tree, arrays, weights(256, 3), "softsign")
    off = np.arange(9)[None] != arrays[0].argmax(1)[:, None]
    assert not np.any(np.asarray(gradient)[off])
    assert np.any(gradient)


def test_observations_have_no_gradient():
    arrays = [jnp.asarray(a) for a in random_tree(0, 3, 4, 2, 5)]
    assert not np.any(jax.jit(jax.grad(lambda x: hard_tree(*arrays[:3], x).sum()))(arrays[3]))


def test_vmap_over_seeds_is_a_loop():
    depth, features = 5, 3
    seeds = [random_tree(seed, depth, features, 2, 32) for seed in range(3)]
    stacked = [jnp.stack([jnp.asarray(s[i]) for s in seeds]) for i in range(4)]
    w = weights(32, 2)

    def value_and_gradient(a, b, c, x):
        return jax.value_and_grad(lambda p: jnp.sum(hard_tree(*p, x) * w))((a, b, c))

    loop = jax.jit(value_and_gradient)
    mapped = jax.jit(jax.vmap(value_and_gradient))(*stacked)
    shared_x = jax.jit(jax.vmap(value_and_gradient, in_axes=(0, 0, 0, None)))(*stacked[:3], stacked[3][0])
    shared_tree = jax.jit(jax.vmap(value_and_gradient, in_axes=(None, None, None, 0)))(
        *(a[0] for a in stacked[:3]), stacked[3]
    )
    for i in range(3):
        one = [a[i] for a in stacked]
        for got, expected in [
            (mapped, loop(*one)),
            (shared_x, loop(*one[:3], stacked[3][0])),
            (shared_tree, loop(*(a[0] for a in stacked[:3]), one[3])),
        ]:
            for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
                np.testing.assert_allclose(a[i], b, rtol=1e-5, atol=1e-5)


def test_jit_changes_nothing():
    arrays = [jnp.asarray(a) for a in random_tree(9, 2, 3, 2, 8)]
    assert np.array_equal(hard_tree(*arrays), jax.jit(hard_tree)(*arrays))


def test_accumulating_minibatches_in_a_scan_is_one_batch():
    *parameters, x = (jnp.asarray(a) for a in random_tree(8, 5, 4, 2, 96))
    w = jnp.asarray(weights(96, 2))
    gradient = jax.jit(jax.grad(lambda p, x, w: jnp.sum(hard_tree(*p, x) * w)))

    def accumulate(total, batch):
        return jax.tree.map(jnp.add, total, gradient(parameters, *batch)), None

    zeros = jax.tree.map(jnp.zeros_like, parameters)
    total, _ = jax.lax.scan(accumulate, zeros, (np.reshape(x, (4, 24, 4)), np.reshape(w, (4, 24, 2))))
    for a, b in zip(total, gradient(parameters, x, w), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)


def test_the_deepest_tree_trains():
    arrays = random_tree(0, 14, 2, 2, 64)
    got = gradients(hard_tree, arrays, weights(64, 2), "sigmoid")
    assert all(np.isfinite(g).all() and np.any(g) for g in got)


def test_a_thousand_features():
    arrays = random_tree(0, 4, 1000, 2, 16)
    w = weights(16, 2)
    assert_close(gradients(hard_tree, arrays, w, "sigmoid"), textbook_gradients(arrays, w, "sigmoid"))


GOOD = random_tree(0, 3, 4, 2, 5)


@pytest.mark.parametrize(
    ("position", "array", "message"),
    [
        (2, np.zeros((2**15, 2)), "depth must be between 1 and 14, got 15"),
        (2, np.zeros((1, 2)), "depth must be between 1 and 14, got 0"),
        (2, np.zeros((6, 2)), "leaf_values must have 2\\^depth rows, .* got 6"),
        (2, np.zeros((4, 2)), "feature_logits must have shape \\(3, 4\\)"),
        (1, np.zeros((7, 3)), "thresholds must have shape \\(7, 4\\)"),
        (3, np.zeros((5, 3)), "feature_logits must have shape \\(7, 3\\)"),
        (3, np.zeros(4), "x must have 2 axes, got shape \\(4,\\); .*vmap"),
        (3, np.zeros((5, 0)), "x must have at least one feature"),
        (3, np.zeros((5, 4), np.int32), "x must be float32, got int32"),
    ],
)
def test_wrong_shapes_are_named_at_the_door(position, array, message):
    arrays = [jnp.asarray(a) for a in GOOD]
    arrays[position] = jnp.asarray(array, None if array.dtype == np.int32 else np.float32)
    with pytest.raises(ValueError, match=message):
        hard_tree(*arrays)


def test_a_wrong_surrogate_and_a_tree_that_is_not_full_are_named():
    arrays = [jnp.asarray(a) for a in GOOD]
    with pytest.raises(ValueError, match="surrogate must be one of sigmoid, softsign, got 'relu'"):
        hard_tree(*arrays, surrogate="relu")
    with pytest.raises(ValueError, match="inner nodes, got 6"):
        leaf_index(jnp.zeros(6, jnp.int32), jnp.zeros(6), jnp.zeros((2, 1)))
