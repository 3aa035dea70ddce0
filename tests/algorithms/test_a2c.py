"""A2C's loss and its gradient against NumPy, and its one step of the optimiser a rollout."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.a2c import A2C, a2c_loss
from sympol.algorithms.algorithm import Experience
from sympol.algorithms.config import Config
from sympol.algorithms.initialization import init_networks
from sympol.algorithms.on_policy import Batch
from sympol.algorithms.optim import ADAM_EPS, apply_gradients, labels, optimizer
from sympol.algorithms.ppo import ppo_loss
from sympol.algorithms.state import Networks, Normalizer, TrainState
from sympol.policies.distributions import Categorical, DiagonalGaussian
from sympol.types import Transition
from tests.algorithms.programs import state_with

DISCRETE, GAUSSIAN = Categorical(3), DiagonalGaussian((-1.0, -1.0), (1.0, 1.0), (2,))
SPACES = pytest.mark.parametrize("distribution", [DISCRETE, GAUSSIAN], ids=["discrete", "gaussian"])
POLICIES = pytest.mark.parametrize("policy", ["tree", "mlp", "sdt"])
RIVALS = pytest.mark.parametrize("policy", ["mlp", "sdt"])
OWN = {"tree": {"depth": 2}, "sdt": {"depth": 2, "temperature": 1.5}, "mlp": {"actor_hidden": (6,)}}
BATCH, FEATURES = 64, 3
ENT_COEF = 0.03
PARTS = ("train/policy_gradient_loss", "train/value_loss", "train/entropy")
loss_and_gradient = jax.jit(jax.value_and_grad(a2c_loss, has_aux=True), static_argnums=1)
ppo_gradient = jax.jit(jax.grad(ppo_loss, has_aux=True), static_argnums=1)
step = jax.jit(apply_gradients)


def config(policy: str, **changes: Any) -> Config:
    values = {"critic_hidden": (5,), "ent_coef": ENT_COEF, "vf_coef": 0.7, "log_std_init": -0.3}
    return Config(algorithm="a2c", policy=policy, **{**OWN[policy], **values, **changes})


def widened(networks: Any, seed: int = 0) -> Any:
    """Every parameter moved, so that no output is near zero any more."""
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda a: np.asarray(a) + np.float32(0.7 * rng.normal(size=a.shape)), networks)


@functools.cache
def networks_of(distribution, policy: str) -> Networks:
    c = config(policy)
    return widened(init_networks(c, distribution, FEATURES, c.hyperparameters(), jax.random.key(0)))


def batch_of(distribution, n: int = BATCH) -> Batch:
    rng = np.random.default_rng(n)
    normal = lambda *shape: rng.normal(size=shape).astype(np.float32)  # noqa: E731
    action = rng.integers(3, size=n).astype(np.int32) if distribution is DISCRETE else normal(n, 2)
    rows = (normal(n, FEATURES), action, normal(n) - 1.5, normal(n), normal(n))
    return Batch(*map(jnp.asarray, rows))


def in_numpy(distribution, outputs: np.ndarray, log_std: np.ndarray, batch: Batch) -> dict[str, np.ndarray]:
    """Mnih et al. (2016), section 4, sample by sample: −A log π, H, and their slopes in outputs and log σ."""
    rows: list[dict[str, Any]] = []
    for output, action, advantage in zip(
        outputs, *map(np.asarray, (batch.action, batch.advantage)), strict=True
    ):
        if distribution is DISCRETE:
            p = np.exp(output) / np.exp(output).sum()
            entropy = -(p * np.log(p)).sum()
            rows.append(
                {
                    "policy_loss": -advantage * np.log(p[action]),
                    "entropy": entropy,
                    "policy_slope": -advantage * (np.eye(3)[action] - p),
                    "entropy_slope": -p * (np.log(p) + entropy),
                    "policy_slope_std": np.zeros(0),
                    "entropy_slope_std": np.zeros(0),
                }
            )
        else:
            std = np.exp(log_std)
            z = (action - output) / std
            rows.append(
                {
                    "policy_loss": advantage * np.sum(0.5 * z**2 + np.log(std * np.sqrt(2 * np.pi))),
                    "entropy": np.sum(0.5 * np.log(2 * np.pi * np.e * std**2)),
                    "policy_slope": -advantage * z / std,
                    "entropy_slope": np.zeros(2),
                    "policy_slope_std": -advantage * (z**2 - 1),
                    "entropy_slope_std": np.ones(2),
                }
            )
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def forward(networks: Networks, x: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    return networks.actor(x), networks.actor.log_std, networks.critic(x)[:, 0]


jitted_forward = jax.jit(forward)
pull_back = jax.jit(lambda networks, x, v: jax.vjp(lambda n: forward(n, x), networks)[1](v)[0])


@SPACES
@POLICIES
def test_loss_and_gradient_equal_numpy(distribution, policy):
    """The policy gradient −A (one-hot(a) − π) and its like, put through the networks; the actors have tests of their
    own."""
    networks, batch, hyper = (
        networks_of(distribution, policy),
        batch_of(distribution),
        config(policy).hyperparameters(),
    )
    found = jitted_forward(networks, batch.x)
    outputs, log_std, value = (np.asarray(a, np.float64) for a in found)
    expected = in_numpy(distribution, outputs, log_std, batch)
    error = value - np.asarray(batch.value_target, np.float64)
    parts = [expected["policy_loss"].mean(), 0.5 * np.mean(error**2), expected["entropy"].mean()]

    (loss, aux), gradient = loss_and_gradient(networks, distribution, hyper, jnp.float32(ENT_COEF), batch)
    np.testing.assert_allclose([float(aux[name]) for name in PARTS], parts, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(loss, parts[0] + 0.7 * parts[1] - ENT_COEF * parts[2], rtol=1e-4)

    slope, slope_std = (
        expected[f"policy_slope{of}"] - ENT_COEF * expected[f"entropy_slope{of}"] for of in ("", "_std")
    )
    slopes = (slope / BATCH, slope_std.mean(0), 0.7 * error / BATCH)
    through = pull_back(networks, batch.x, tuple(np.float32(s) for s in slopes))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5), gradient, through)
    assert all(np.any(leaf) for leaf in jax.tree.leaves(gradient) if leaf.size)


@SPACES
@POLICIES
def test_it_is_ppo_at_the_policy_that_acted(distribution, policy):
    """There the ratio is 1 and its slope that of log π: the same gradient."""
    networks, batch, hyper = (
        networks_of(distribution, policy),
        batch_of(distribution),
        config(policy).hyperparameters(),
    )
    outputs, log_std, _ = jitted_forward(networks, batch.x)
    batch = batch._replace(log_prob=distribution.log_prob(outputs, log_std, batch.action))
    ours = loss_and_gradient(networks, distribution, hyper, jnp.float32(ENT_COEF), batch)[1]
    theirs, _ = ppo_gradient(networks, distribution, hyper, jnp.float32(ENT_COEF), batch)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6), ours, theirs)


# --- one step a rollout ---

ENVS, STEPS, MAX_CHUNKS = 2, 16, 4


def learner(distribution, policy: str, **changes: Any) -> tuple[Config, TrainState, Transition, jax.Array]:
    """A state and the longest rollout of random numbers, with ends of both kinds."""
    values = {"num_envs": ENVS, "num_steps": STEPS, "growth": MAX_CHUNKS, "max_grad_norm": 0.1}
    c = config(policy, **{**values, "learning_rate_critic": 0.02, **changes})
    assert (c.chunk_steps, 1 << c.max_stage) == (STEPS, MAX_CHUNKS)
    shift = np.zeros(FEATURES, np.float32)
    state = state_with(c, distribution, Normalizer(shift, shift + 1), 1)
    networks = widened(state.networks)
    opt_state = optimizer(c.hyperparameters(), jnp.float32(1), networks).init(networks)
    rng, axes = np.random.default_rng(5), (MAX_CHUNKS, STEPS, ENVS)
    normal = lambda *shape: jnp.asarray(rng.normal(size=shape), jnp.float32)  # noqa: E731
    terminated = rng.random(axes) < 0.1
    rollout = Transition(
        observation=normal(*axes, FEATURES),
        action=jnp.asarray(rng.integers(3, size=axes), jnp.int32)
        if distribution is DISCRETE
        else normal(*axes, 2),
        reward=normal(*axes),
        terminated=jnp.asarray(terminated),
        truncated=jnp.asarray((rng.random(axes) < 0.1) & ~terminated),
        last_observation=normal(*axes, FEATURES),
    )
    return c, state._replace(networks=networks, opt_state=opt_state), rollout, normal(ENVS, FEATURES)


def as_one_batch(c: Config, state: TrainState, rollout: Transition, next_x: jax.Array) -> Batch:
    """The whole rollout, its chunks put together, with advantages by the recursion backwards in time."""
    steps: Any = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), rollout)
    critic = jax.jit(lambda x: state.networks.critic(x.reshape(-1, FEATURES))[:, 0].reshape(x.shape[:-1]))
    value, last_value = (
        np.asarray(critic(x), np.float64) for x in (steps.observation, steps.last_observation)
    )
    following, later, advantage = np.asarray(critic(next_x), np.float64), np.zeros(ENVS), np.zeros_like(value)
    for t in reversed(range(len(value))):
        ended = np.asarray(steps.terminated[t] | steps.truncated[t])
        after = np.where(steps.terminated[t], 0, np.where(steps.truncated[t], last_value[t], following))
        delta = np.asarray(steps.reward[t]) + c.gamma * after - value[t]
        later = delta + c.gamma * c.gae_lambda * np.where(ended, 0, later)
        advantage[t], following = later, value[t]
    target = advantage + value
    advantage = (advantage - advantage.mean()) / advantage.std()
    rows = (steps.observation, steps.action, np.zeros_like(value), advantage, target)
    rows = (np.asarray(a).reshape(-1, *a.shape[2:]) for a in rows)
    return Batch(*(jnp.asarray(a, jnp.float32 if a.dtype.kind == "f" else a.dtype) for a in rows))


def optimiser_steps(state: TrainState) -> set[int]:
    found = jax.tree_util.tree_leaves_with_path(state.opt_state)
    return {int(leaf) for path, leaf in found if jax.tree_util.keystr(path).endswith(".count")}


@pytest.mark.parametrize("stage", [0, 1, 2])
@pytest.mark.parametrize(
    ("policy", "distribution"),
    [("tree", DISCRETE), ("mlp", GAUSSIAN), ("sdt", DISCRETE)],
    ids=["tree-discrete", "mlp-gaussian", "sdt-discrete"],
)
def test_a_rollout_is_one_batch_and_one_step_whatever_its_length(policy, distribution, stage):
    """What lies behind the rollout's end in its buffer is never looked at: here it is NaN."""
    c, state, rollout, next_x = learner(distribution, policy)
    hyper, num_chunks = c.hyperparameters(), 1 << stage
    buffer = jax.tree.map(np.array, rollout)
    for leaf in jax.tree.leaves(buffer):
        leaf[num_chunks:] = np.nan if leaf.dtype == np.float32 else 1
    after = learn_once(c, distribution)(hyper, state, buffer, next_x, np.int32(stage))
    assert optimiser_steps(state) == {0}
    assert optimiser_steps(after) == {1}

    batch = as_one_batch(c, state, jax.tree.map(lambda a: a[:num_chunks], rollout), next_x)
    assert batch.x.shape == (num_chunks * STEPS * ENVS, FEATURES)
    (_, aux), gradient = loss_and_gradient(state.networks, distribution, hyper, jnp.float32(ENT_COEF), batch)
    for name, value in aux.items():
        np.testing.assert_allclose(after.metrics[name], value, rtol=1e-4, atol=1e-5)
    assert max(map(norm, gradient)) > 0.1  # so that it matters what is clipped: their mean, not the parts
    networks, opt_state = step(state.networks, gradient, state.opt_state, hyper, jnp.float32(1))
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6), after.opt_state, opt_state
    )
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=2e-5), after.networks, networks
    )
    for name in ("key", "timestep", "iteration", "normalizer", "validation"):  # not this function's business
        jax.tree.map(np.testing.assert_array_equal, getattr(after, name), getattr(state, name))


@functools.cache
def learn_once(c: Config, distribution):
    """One program for all stages: the number of chunks is traced."""
    update = A2C(c, distribution, FEATURES).update

    @jax.jit
    def learn(hyper, state, rollout, next_x, stage):
        state, metrics = update(hyper, state, Experience(rollout, next_x, stage), jax.random.key(0))
        return state._replace(metrics=metrics)

    return learn


def norm(gradient: Any) -> float:
    return float(
        np.sqrt(sum(np.sum(np.square(leaf, dtype=np.float64)) for leaf in jax.tree.leaves(gradient)))
    )


def test_the_schedules_of_coefficients_reach_the_step():
    """Half way, after one plateau: the rate is ½ · (1 + 0.2)/2, the entropy bonus (1 + 0)/2."""
    c, state, rollout, next_x = learner(DISCRETE, "mlp", lr_end_factor=0.2, ent_end_factor=0.0)
    state = state._replace(timestep=jnp.int32(c.total_timesteps // 2))
    state = state._replace(validation=state.validation._replace(lr_factor=jnp.float32(0.5)))
    after = learn_once(c, DISCRETE)(c.hyperparameters(), state, rollout, next_x, np.int32(2))
    batch = as_one_batch(c, state, rollout, next_x)
    gradient = loss_and_gradient(
        state.networks, DISCRETE, c.hyperparameters(), jnp.float32(ENT_COEF / 2), batch
    )[1]
    networks, _ = step(state.networks, gradient, state.opt_state, c.hyperparameters(), jnp.float32(0.3))
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=2e-5), after.networks, networks
    )


# --- the groups of parameters of actors that are no tree ---


def optimiser_case(policy: str, **changes: Any):
    networks: Any = networks_of(GAUSSIAN, policy)
    hyper = config(policy, **changes).hyperparameters()
    gradient = jax.tree.map(
        lambda a: jnp.asarray(np.random.default_rng(a.size).normal(size=a.shape), jnp.float32), networks
    )
    return networks, gradient, optimizer(hyper, jnp.float32(1), networks).init(networks), hyper


@pytest.mark.parametrize(("policy", "critic"), [("mlp", "mlp"), ("sdt", "mlp"), ("sdt", "sdt")])
def test_every_parameter_has_its_group(policy, critic):
    c = config(policy, critic=critic)
    groups = labels(init_networks(c, GAUSSIAN, FEATURES, c.hyperparameters(), jax.random.key(0)))
    found = {
        jax.tree_util.keystr(path): group for path, group in jax.tree_util.tree_leaves_with_path(groups.actor)
    }
    assert found.pop(".log_std") == "log_std"
    parameters = {
        "mlp": {".net.weights[0]", ".net.weights[1]", ".net.biases[0]", ".net.biases[1]"},
        "sdt": {".feature_logits", ".thresholds", ".leaf_values"},
    }[policy]
    assert found == dict.fromkeys(parameters, "actor")
    assert {*jax.tree.leaves(groups.critic)} == {"critic"}


@RIVALS
@pytest.mark.parametrize("still", ["actor", "log_std", "critic"])
def test_a_group_with_rate_zero_stands_still_and_only_it(policy, still):
    networks, gradient, opt_state, hyper = optimiser_case(policy, **{f"learning_rate_{still}": 0.0})
    after, _ = step(networks, gradient, opt_state, hyper, jnp.float32(1))
    groups = labels(networks)
    for group, before, now in zip(*map(jax.tree.leaves, (groups, networks, after)), strict=True):
        assert np.array_equal(before, now) == (group == still)


@RIVALS
def test_one_step_is_adamw_with_the_group_s_rate_and_decays_all_of_the_actor_but_its_noise(policy):
    """After one step Adam's direction is g / (|g| + ε)."""
    rates = {"actor": 0.1, "log_std": 0.2, "critic": 0.3}
    networks, gradient, opt_state, hyper = optimiser_case(
        policy, weight_decay=0.5, **{f"learning_rate_{name}": rate for name, rate in rates.items()}
    )
    factor = 0.7
    after, _ = step(networks, gradient, opt_state, hyper, jnp.float32(factor))
    leaves = map(jax.tree.leaves, (labels(networks), networks, gradient, after))
    for group, p, g, now in zip(*leaves, strict=True):
        p, g = np.asarray(p, np.float64), np.asarray(g, np.float64)
        decay = 0.5 if group == "actor" else 0
        expected = p - factor * rates[group] * (g / (np.abs(g) + ADAM_EPS) + decay * p)
        np.testing.assert_allclose(now, expected, rtol=1e-4, atol=1e-5, err_msg=group)
