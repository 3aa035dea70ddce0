"""Units of continuous actions: powers of two, exact in every float32, the middle of the range at first."""

from __future__ import annotations

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.policies.action_units import add_to_outputs, multiply_outputs, units_and_centers
from sympol.policies.distributions import DiagonalGaussian, distribution_of
from sympol.policies.mlp import MLPActor
from sympol.policies.soft_tree import SoftTree
from sympol.policies.tree import Tree

LOW, HIGH = [0.0, -3.0, -1.0, -np.inf, 5.0], [100.0, 40.0, 1.0, 1.0, 5.5]
SPACE = gymnasium.spaces.Box(np.array(LOW, np.float32), np.array(HIGH, np.float32))
SIZE = {"num_features": 3, "num_outputs": 5}


X = np.random.default_rng(0).normal(size=(64, 3)).astype(np.float32)


def means(actor) -> np.ndarray:
    return np.asarray(jax.jit(lambda actor, x: actor.rollout()(x))(actor, X))


def actors():
    key = jax.random.key(0)
    yield Tree.create(key, depth=2, num_std=5, **SIZE)
    yield SoftTree.create(key, depth=2, num_std=5, **SIZE)
    yield MLPActor.create(key, (3, 4, 5), num_std=5)


def test_half_the_range_is_between_one_and_two_units_and_units_are_powers_of_two():
    units, centers = units_and_centers(SPACE, scaled=True)
    assert units.tolist() == [32, 16, 1, 1, 0.25]
    half = (np.array(HIGH) - np.array(LOW))[[0, 1, 2, 4]] / 2
    assert ((half / units[[0, 1, 2, 4]] >= 1) & (half / units[[0, 1, 2, 4]] < 2)).all()
    np.testing.assert_array_equal(centers * units, [50, 18.5, 0, 0, 5.25])


@pytest.mark.parametrize("space", [SPACE, gymnasium.spaces.Discrete(3)])
def test_without_scaling_nothing_changes(space):
    units, centers = units_and_centers(space, scaled=False)
    assert (units == 1).all()
    assert (centers == 0).all()
    assert len(units) == (5 if space is SPACE else 0)


@pytest.mark.parametrize("actor", list(actors()), ids=lambda actor: type(actor).__name__)
def test_an_actor_in_other_units_acts_the_same_to_the_bit(actor):
    units, _ = units_and_centers(SPACE, scaled=True)
    raw = multiply_outputs(actor, units)
    np.testing.assert_array_equal(means(raw), means(actor) * units)
    np.testing.assert_allclose(np.exp(raw.log_std), np.exp(actor.log_std) * units, rtol=1e-6)
    back = multiply_outputs(raw, 1 / units)
    np.testing.assert_array_equal(means(back), means(actor))


@pytest.mark.parametrize("actor", list(actors()), ids=lambda actor: type(actor).__name__)
def test_the_policy_begins_in_the_middle_of_the_range(actor):
    units, centers = units_and_centers(SPACE, scaled=True)
    moved = add_to_outputs(multiply_outputs(actor, np.full(5, 0.0625, np.float32)), centers)
    middle = np.where(np.isfinite(LOW), (np.array(LOW) + np.array(HIGH)) / 2, 0)
    assert (np.abs(means(moved) * units - middle) < 0.3 * units).all()


def test_actions_are_clipped_in_the_units_of_the_environment():
    distribution = distribution_of(SPACE, scaled=True)
    assert isinstance(distribution, DiagonalGaussian)
    action = jnp.array([[1.0, 9.0, -2.0, -2.0, 21.5]])
    np.testing.assert_array_equal(distribution.to_env(action)[0], [32, 40, -1, -2, 5.375])
