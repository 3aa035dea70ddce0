"""What the numbers in a leaf mean, against the textbook in NumPy."""

from __future__ import annotations

import math

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.policies.distributions import Categorical, DiagonalGaussian, MultiCategorical, distribution_of

EMPTY = jnp.zeros(0)
BOX = DiagonalGaussian(low=(-1.0, -0.5), high=(1.0, 2.0), shape=(2,))


def normal(seed: int, *shape: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def softmax(logits: np.ndarray) -> np.ndarray:
    weights = np.exp(logits.astype(np.float64))
    return weights / weights.sum(-1, keepdims=True)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_categorical_log_prob_and_entropy(n):
    logits, action = 3 * normal(n, 50, n), np.random.default_rng(0).integers(n, size=50)
    p = softmax(logits)
    d = Categorical(n)
    log_prob = d.log_prob(jnp.asarray(logits), EMPTY, jnp.asarray(action, jnp.int32))
    np.testing.assert_allclose(log_prob, np.log(p[np.arange(50), action]), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(
        d.entropy(jnp.asarray(logits), EMPTY), -(p * np.log(p)).sum(-1), rtol=1e-5, atol=1e-6
    )


def test_categorical_takes_any_leading_axes():
    logits, action = normal(0, 3, 4, 5), np.random.default_rng(0).integers(5, size=(3, 4))
    d = Categorical(5)
    whole = d.log_prob(jnp.asarray(logits), EMPTY, jnp.asarray(action, jnp.int32))
    parts = [
        [float(d.log_prob(jnp.asarray(logits[i, j]), EMPTY, jnp.int32(action[i, j]))) for j in range(4)]
        for i in range(3)
    ]
    np.testing.assert_allclose(whole, parts, rtol=1e-6)
    assert d.entropy(jnp.asarray(logits), EMPTY).shape == (3, 4)


def test_categorical_extreme_logits_stay_finite():
    logits = jnp.array([[1000.0, -1000.0], [0.0, 0.0]])
    d = Categorical(2)
    assert np.isfinite(d.log_prob(logits, EMPTY, jnp.array([1, 1]))).all()
    np.testing.assert_allclose(d.entropy(logits, EMPTY), [0, math.log(2)], atol=1e-6)
    grad = jax.grad(lambda x: jnp.sum(d.entropy(x, EMPTY) + d.log_prob(x, EMPTY, jnp.array([0, 1]))))(logits)
    assert np.isfinite(grad).all()


def test_categorical_samples_as_often_as_it_says():
    logits = np.log(np.float32([0.5, 0.3, 0.15, 0.05]))
    d, n = Categorical(4), 200_000
    noise = d.noise(jax.random.key(0), (n,))
    action = d.sample(jnp.broadcast_to(jnp.asarray(logits), (n, 4)), EMPTY, noise)
    assert action.dtype == jnp.int32
    frequency = np.bincount(np.asarray(action), minlength=4) / n
    np.testing.assert_allclose(frequency, [0.5, 0.3, 0.15, 0.05], atol=0.004)  # 4 standard errors


def test_modes_take_the_first_of_equals():
    np.testing.assert_array_equal(Categorical(3).mode(jnp.array([[1.0, 2.0, 2.0], [0.0, 0.0, 0.0]])), [1, 0])
    multi = MultiCategorical((2, 3))
    np.testing.assert_array_equal(multi.mode(jnp.array([[1.0, 1.0, 0.0, 5.0, 5.0]])), [[0, 1]])
    np.testing.assert_array_equal(BOX.mode(jnp.array([[7.0, -7.0]])), [[7, -7]])


def test_multi_categorical_is_the_sum_of_its_parts():
    d = MultiCategorical((2, 3, 4))
    assert (d.num_outputs, d.num_std) == (9, 0)
    outputs = jnp.asarray(normal(0, 6, 9))
    rng = np.random.default_rng(0)
    action = jnp.asarray(np.stack([rng.integers(n, size=6) for n in d.nvec], -1), jnp.int32)
    parts = [(Categorical(n), outputs[:, s : s + n], i) for i, (n, s) in enumerate([(2, 0), (3, 2), (4, 5)])]
    np.testing.assert_allclose(
        d.log_prob(outputs, EMPTY, action),
        sum(part.log_prob(logits, EMPTY, action[:, i]) for part, logits, i in parts),
        rtol=1e-6,
    )
    np.testing.assert_allclose(
        d.entropy(outputs, EMPTY), sum(part.entropy(logits, EMPTY) for part, logits, _ in parts), rtol=1e-6
    )
    noise = d.noise(jax.random.key(1), (6,))
    sample = d.sample(outputs, EMPTY, noise)
    assert (sample.shape, sample.dtype) == ((6, 3), jnp.int32)
    for part, logits, i in parts:
        start = sum(d.nvec[:i])
        expected = part.sample(logits, EMPTY, noise[:, start : start + part.n])
        np.testing.assert_array_equal(sample[:, i], expected)


def test_multi_categorical_samples_as_often_as_it_says():
    p = [np.float32([0.8, 0.2]), np.float32([0.1, 0.6, 0.3])]
    d, n = MultiCategorical((2, 3)), 100_000
    outputs = jnp.broadcast_to(jnp.asarray(np.log(np.concatenate(p))), (n, 5))
    action = np.asarray(d.sample(outputs, EMPTY, d.noise(jax.random.key(3), (n,))))
    joint = np.zeros((2, 3))
    np.add.at(joint, (action[:, 0], action[:, 1]), 1 / n)
    np.testing.assert_allclose(joint, np.outer(*p), atol=0.006)  # independent, too


def density(action: np.ndarray, mean: np.ndarray, log_std: np.ndarray) -> np.ndarray:
    std = np.exp(log_std.astype(np.float64))
    return np.prod(np.exp(-((action - mean) ** 2) / (2 * std**2)) / (std * math.sqrt(2 * math.pi)), axis=-1)


def test_gaussian_log_prob_and_entropy():
    mean, action, log_std = normal(0, 30, 2), normal(1, 30, 2), np.float32([-0.7, 0.4])
    log_prob = BOX.log_prob(jnp.asarray(mean), jnp.asarray(log_std), jnp.asarray(action))
    np.testing.assert_allclose(log_prob, np.log(density(action, mean, log_std)), rtol=1e-5, atol=1e-5)
    entropy = BOX.entropy(jnp.asarray(mean), jnp.asarray(log_std))
    expected = sum(0.5 * math.log(2 * math.pi * math.e * math.exp(2 * s)) for s in log_std.tolist())
    np.testing.assert_allclose(entropy, np.full(30, expected), rtol=1e-6)


def test_gaussian_samples_with_its_mean_and_deviation():
    n, mean, log_std = 200_000, jnp.array([3.0, -2.0]), jnp.log(jnp.array([0.5, 2.0]))
    outputs = jnp.broadcast_to(mean, (n, 2))
    action = np.asarray(BOX.sample(outputs, log_std, BOX.noise(jax.random.key(0), (n,))))
    np.testing.assert_allclose(action.mean(0), mean, atol=0.02)
    np.testing.assert_allclose(action.std(0), [0.5, 2], rtol=0.01)
    assert abs(np.corrcoef(action.T)[0, 1]) < 0.01
    within = (np.abs(action - np.asarray(mean)) < np.float32([0.5, 2])).mean(0)
    np.testing.assert_allclose(within, math.erf(math.sqrt(0.5)), atol=0.005)


def test_only_the_environment_sees_the_bounds():
    """The sample keeps what was drawn, and its density is that of the unclipped value."""
    outputs, log_std = jnp.array([[5.0, 0.0]]), jnp.zeros(2)
    action = BOX.sample(outputs, log_std, jnp.array([[1.0, -3.0]]))
    np.testing.assert_array_equal(action, [[6, -3]])
    np.testing.assert_array_equal(BOX.to_env(action), [[1, -0.5]])
    np.testing.assert_allclose(
        BOX.log_prob(outputs, log_std, action), [-(1 + 9) / 2 - math.log(2 * math.pi)], rtol=1e-6
    )


def test_actions_reach_the_environment_in_its_shape():
    space = gymnasium.spaces.Box(-1, 1, (2, 3), np.float32)
    d = distribution_of(space)
    assert (d.num_outputs, d.num_std) == (6, 6)
    action = jnp.asarray(normal(0, 4, 6))
    env_action = d.to_env(action)
    assert env_action.shape == (4, 2, 3)
    np.testing.assert_array_equal(env_action, np.clip(np.asarray(action), -1, 1).reshape(4, 2, 3))
    assert d.to_env(action[0]).shape == (2, 3)


def test_spaces_and_their_distributions():
    assert distribution_of(gymnasium.spaces.Discrete(3, start=5)) == Categorical(3)
    assert distribution_of(gymnasium.spaces.MultiDiscrete([2, 3])) == MultiCategorical((2, 3))
    half_open = gymnasium.spaces.Box(np.float32([-np.inf, 0]), np.float32([1, np.inf]), (2,), np.float32)
    d = distribution_of(half_open)
    np.testing.assert_array_equal(d.to_env(jnp.array([[-9.0, 9.0]])), [[-9, 9]])
    with pytest.raises(TypeError, match="Discrete, MultiDiscrete or Box"):
        distribution_of(gymnasium.spaces.MultiBinary(3))
