"""The loss, its gradient and the optimiser step against NumPy."""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from sympol.algorithms.config import Config, Hyperparameters
from sympol.algorithms.initialization import init_networks
from sympol.algorithms.on_policy import Batch
from sympol.algorithms.optim import ADAM_EPS, apply_gradients, labels, optimizer
from sympol.algorithms.ppo import ppo_loss
from sympol.algorithms.state import Networks
from sympol.policies.distributions import Categorical, DiagonalGaussian

DISCRETE, GAUSSIAN = Categorical(3), DiagonalGaussian((-1.0,), (1.0,), (1,))
SPACES = pytest.mark.parametrize("distribution", [DISCRETE, GAUSSIAN], ids=["discrete", "gaussian"])
BATCH, FEATURES = 64, 3
PARTS = ("policy_gradient_loss", "value_loss", "entropy", "approx_kl", "clip_fraction")
loss_and_gradient = jax.jit(jax.value_and_grad(ppo_loss, has_aux=True), static_argnums=1)
step = jax.jit(apply_gradients)


def config(**changes: Any) -> Config:
    return Config(depth=2, critic_hidden=(5,), ent_coef=0.03, vf_coef=0.7, log_std_init=-0.3, **changes)


def networks_of(distribution, seed: int = 0, **changes: Any) -> Networks:
    c = config(**changes)
    networks = init_networks(c, distribution, FEATURES, c.hyperparameters(), jax.random.key(seed))
    wide = 3 * jax.random.normal(jax.random.key(seed + 1), networks.actor.leaf_values.shape)
    return networks._replace(actor=eqx.tree_at(lambda t: t.leaf_values, networks.actor, wide))


def batch_of(distribution, n: int = BATCH) -> Batch:
    rng = np.random.default_rng(n)
    normal = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    action = rng.integers(3, size=n).astype(np.int32) if distribution is DISCRETE else normal(n, 1)
    rows = (normal(n, FEATURES), action, normal(n) - 1.5, normal(n), normal(n))
    return Batch(*map(jnp.asarray, rows))


def in_numpy(networks: Networks, distribution, hyper: Hyperparameters, ent_coef: float, batch: Batch):
    """The clipped surrogate (Schulman et al. 2017, eq. 7), sample by sample in float64."""
    actor, critic = networks
    x = np.asarray(batch.x)
    policy_loss = value_loss = entropy = clipped_count = kl = 0.0
    for i in range(len(x)):
        node = 0
        while node < 3:
            feature = int(np.argmax(actor.feature_logits[node]))
            node = 2 * node + (1 if x[i, feature] <= actor.thresholds[node, feature] else 2)
        output = np.asarray(actor.leaf_values[node - 3], np.float64)
        if distribution is DISCRETE:
            p = np.exp(output) / np.exp(output).sum()
            log_prob = np.log(p[int(batch.action[i])])
            entropy -= (p * np.log(p)).sum()
        else:
            std = np.exp(float(actor.log_std[0]))
            z = (float(batch.action[i, 0]) - output[0]) / std
            log_prob = -0.5 * z**2 - np.log(std * np.sqrt(2 * np.pi))
            entropy += 0.5 * np.log(2 * np.pi * np.e * std**2)
        log_ratio = log_prob - float(batch.log_prob[i])
        ratio, a = np.exp(log_ratio), float(batch.advantage[i])
        policy_loss -= min(ratio * a, np.clip(ratio, 1 - hyper.clip_eps, 1 + hyper.clip_eps) * a)
        clipped_count += abs(ratio - 1) > hyper.clip_eps
        kl += ratio - 1 - log_ratio
        h = np.tanh(x[i] @ np.asarray(critic.weights[0], np.float64) + np.asarray(critic.biases[0]))
        value = (h @ np.asarray(critic.weights[1], np.float64) + np.asarray(critic.biases[1]))[0]
        value_loss += 0.5 * (value - float(batch.value_target[i])) ** 2
    parts = np.array([policy_loss, value_loss, entropy, kl, clipped_count]) / len(x)
    return parts[0] + hyper.vf_coef * parts[1] - ent_coef * parts[2], parts


@SPACES
def test_loss_equals_numpy(distribution):
    networks, batch, hyper = networks_of(distribution), batch_of(distribution), config().hyperparameters()
    (loss, aux), _ = loss_and_gradient(networks, distribution, hyper, jnp.float32(0.03), batch)
    expected, parts = in_numpy(networks, distribution, hyper, 0.03, batch)
    np.testing.assert_allclose(loss, expected, rtol=1e-4)
    np.testing.assert_allclose([float(aux[f"train/{name}"]) for name in PARTS], parts, rtol=1e-4, atol=1e-5)
    assert 0 < aux["train/clip_fraction"] < 1


@SPACES
def test_actor_and_critic_do_not_touch_each_other(distribution):
    """Without the critic's loss the critic has no gradient, and the actor's does not change; and vice versa."""
    networks, batch, hyper = networks_of(distribution), batch_of(distribution), config().hyperparameters()
    gradient = loss_and_gradient(networks, distribution, hyper, jnp.float32(0.03), batch)[1]
    no_critic = hyper._replace(vf_coef=np.float32(0))
    alone = loss_and_gradient(networks, distribution, no_critic, jnp.float32(0.03), batch)[1]
    assert all(not np.any(leaf) for leaf in jax.tree.leaves(alone.critic))
    jax.tree.map(np.testing.assert_array_equal, alone.actor, gradient.actor)

    idle = batch._replace(advantage=jnp.zeros(BATCH))
    quiet = loss_and_gradient(networks, distribution, hyper, jnp.float32(0), idle)[1]
    assert all(not np.any(leaf) for leaf in jax.tree.leaves(quiet.actor))
    jax.tree.map(np.testing.assert_array_equal, quiet.critic, gradient.critic)
    assert all(np.any(leaf) for leaf in jax.tree.leaves(gradient.critic))


@SPACES
def test_gradients_of_micro_batches_average_to_that_of_the_batch(distribution):
    networks, batch, hyper = networks_of(distribution), batch_of(distribution), config().hyperparameters()
    whole = loss_and_gradient(networks, distribution, hyper, jnp.float32(0.03), batch)[1]
    parts = [
        loss_and_gradient(
            networks,
            distribution,
            hyper,
            jnp.float32(0.03),
            jax.tree.map(lambda a, i=i: a[i : i + 16], batch),
        )[1]
        for i in range(0, BATCH, 16)
    ]
    mean = jax.tree.map(lambda *leaves: sum(np.asarray(leaf) for leaf in leaves) / 4, *parts)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6), mean, whole)


def optimiser_case(seed: int = 0, **changes: Any):
    c = dataclasses.replace(config(), **changes)
    networks: Any = networks_of(GAUSSIAN, seed)
    hyper = c.hyperparameters()
    gradient = jax.tree.map(
        lambda a: jnp.asarray(np.random.default_rng(a.size).normal(size=a.shape), jnp.float32), networks
    )
    return networks, gradient, optimizer(hyper, jnp.float32(1), networks).init(networks), hyper


def test_one_step_is_adamw_in_numpy():
    """Two steps of Loshchilov & Hutter's AdamW with a rate for each group, decay on splits and leaves only."""
    rates = {"feature_logits": 0.1, "thresholds": 0.2, "leaf_values": 0.3, "log_std": 0.4}
    changes = {f"learning_rate_{name}": rate for name, rate in rates.items()}
    networks, gradient, opt_state, hyper = optimiser_case(
        **changes, learning_rate_critic=0.5, weight_decay=0.05
    )
    factor = 0.7
    now, state = networks, opt_state
    for _ in range(2):
        now, state = step(now, gradient, state, hyper, jnp.float32(factor))

    def adamw(p, g, rate, decay):
        p, g = np.asarray(p, np.float64), np.asarray(g, np.float64)
        m = v = np.zeros_like(p)
        for t in (1, 2):
            m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g**2
            direction = m / (1 - 0.9**t) / (np.sqrt(v / (1 - 0.999**t)) + ADAM_EPS)
            p = p - factor * rate * (direction + decay * p)
        return p

    for name, rate in rates.items():
        decay = 0.05 if name in ("feature_logits", "leaf_values") else 0
        expected = adamw(getattr(networks.actor, name), getattr(gradient.actor, name), rate, decay)
        np.testing.assert_allclose(getattr(now.actor, name), expected, rtol=1e-4, atol=1e-5, err_msg=name)
    expected = jax.tree.map(lambda p, g: adamw(p, g, 0.5, 0), networks.critic, gradient.critic)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), now.critic, expected)


@pytest.mark.parametrize("still", ["feature_logits", "thresholds", "leaf_values", "log_std", "critic"])
def test_a_group_with_rate_zero_stands_still_and_only_it(still):
    networks, gradient, opt_state, hyper = optimiser_case(**{f"learning_rate_{still}": 0.0})
    after, _ = step(networks, gradient, opt_state, hyper, jnp.float32(1))
    groups = labels(networks)
    for group, before, now in zip(*map(jax.tree.leaves, (groups, networks, after)), strict=True):
        assert np.array_equal(before, now) == (group == still)


def test_weight_decay_zero_and_its_targets():
    """With no gradient Adam stands still, so all that moves is decayed."""
    networks, gradient, opt_state, hyper = optimiser_case(weight_decay=0.5, learning_rate_leaf_values=0.1)
    nothing = jax.tree.map(jnp.zeros_like, gradient)
    after, _ = step(networks, nothing, opt_state, hyper, jnp.float32(1))
    for group, before, now in zip(*map(jax.tree.leaves, (labels(networks), networks, after)), strict=True):
        assert np.array_equal(before, now) == (group not in ("feature_logits", "leaf_values"))
    expected = np.asarray(networks.actor.leaf_values) * (1 - 0.1 * 0.5)
    np.testing.assert_allclose(after.actor.leaf_values, expected, rtol=1e-6)
    off = hyper._replace(weight_decay=np.float32(0))
    unmoved, _ = step(networks, nothing, opt_state, off, jnp.float32(1))
    jax.tree.map(np.testing.assert_array_equal, unmoved, networks)


def test_clipping_is_by_the_norm_of_actor_and_critic_apart():
    """Seen through Adam's first moment, a tenth of the gradient it was given."""
    networks, gradient, opt_state, hyper = optimiser_case()
    gradient = gradient._replace(critic=jax.tree.map(lambda g: 100 * g, gradient.critic))

    def moments(max_norm: float) -> Networks:
        clip = hyper._replace(max_grad_norm=np.float32(max_norm))
        _, state = step(networks, gradient, opt_state, clip, jnp.float32(1))
        mus: Any = [part.mu for part in jax.tree.leaves(state, is_leaf=is_adam) if is_adam(part)]
        found: dict[str, Any] = {}
        for mu in mus:
            for path, leaf in jax.tree_util.tree_leaves_with_path(mu):
                found[jax.tree_util.keystr(path)] = 10 * np.asarray(leaf)
        order = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(networks)]
        return jax.tree.unflatten(jax.tree.structure(networks), [found[name] for name in order])

    def is_adam(part: Any) -> bool:
        return isinstance(part, optax.ScaleByAdamState)

    def norm(part: Any) -> float:
        return float(
            np.sqrt(sum(np.sum(np.square(leaf, dtype=np.float64)) for leaf in jax.tree.leaves(part)))
        )

    unclipped = moments(np.inf)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), unclipped, gradient)
    clipped = moments(0.5)
    for part, whole in zip(clipped, gradient, strict=True):
        np.testing.assert_allclose(norm(part), 0.5, rtol=1e-5)
        scale = 0.5 / norm(whole)
        jax.tree.map(lambda a, b, s=scale: np.testing.assert_allclose(a, s * b, rtol=1e-4), part, whole)
    longer = moments(1e6)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-6), longer, gradient)
