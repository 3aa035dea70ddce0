"""The scale of returns: predictions stay when it moves, and it becomes that of the returns."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.algorithms.return_scale import SMALLEST_STD, ReturnScale, rescale_critic
from sympol.policies.mlp import MLP
from sympol.policies.soft_tree import SoftTree
from sympol.policies.tree import Tree
from tests.tiny import TINY

PPO_ONLY = ("minibatch_size", "num_epochs")
X = np.random.default_rng(0).normal(size=(64, 3)).astype(np.float32)


def moments(values: np.ndarray) -> tuple[jnp.ndarray, jnp.ndarray]:
    return jnp.float32(values.mean()), jnp.float32((values**2).mean())


def critics():
    key = jax.random.key(0)
    yield MLP.create(key, (3, 8, 1))
    yield Tree.create(key, depth=2, num_features=3, num_outputs=1)
    yield SoftTree.create(key, depth=2, num_features=3, num_outputs=1)


@pytest.mark.parametrize("critic", list(critics()), ids=lambda critic: type(critic).__name__)
def test_no_prediction_changes_when_the_scale_moves(critic):
    before = ReturnScale.zeros().after(*moments(np.array([-3.0, 5.0])), jnp.float32(2))
    after = before.after(*moments(np.array([-4000.0, -3000.0])), jnp.float32(90))
    moved = rescale_critic(critic, before, after)
    predict = jax.jit(lambda scale, critic, x: scale.to_value(critic(x)[:, 0]))
    values = [predict(scale, c, X) for scale, c in ((before, critic), (after, moved))]
    np.testing.assert_allclose(values[1], values[0], atol=1e-3)  # float32 at a mean of -600


def test_the_first_rollout_sets_the_scale():
    returns = np.random.default_rng(1).normal(-500, 30, 10_000).astype(np.float32)
    scale = ReturnScale.zeros().after(*moments(returns), jnp.float32(10))
    outputs = np.asarray(scale.to_output(returns))
    assert outputs.mean() == pytest.approx(0, abs=1e-2)
    assert outputs.std() == pytest.approx(1, abs=1e-2)
    np.testing.assert_allclose(scale.to_value(outputs), returns, rtol=1e-4)


def test_where_every_reward_is_zero_nothing_is_divided():
    assert ReturnScale.zeros().after(*moments(np.full(9, 0.01)), jnp.float32(0)).std == 1


def test_constant_returns_are_not_divided_by_zero():
    assert ReturnScale.zeros().after(*moments(np.full(9, 7.0)), jnp.float32(2)).std >= 2 * SMALLEST_STD * 0.99


@pytest.mark.parametrize("algorithm", ["ppo", "a2c"])
def test_a_training_keeps_the_scale_in_its_memory(algorithm):
    config = {name: value for name, value in TINY.items() if algorithm == "ppo" or name not in PPO_ONLY}
    make = sympol.PPO if algorithm == "ppo" else sympol.A2C
    agent = make("tree", "CartPole-v1", normalize_returns=True, **config).learn(progress_bar=False)
    assert agent.state is not None
    assert int(agent.state.memory.returns.num_rollouts) > 0
    assert np.isfinite(float(agent.state.memory.returns.mean))
