"""Validation, plateaus, and the sums of episodes."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.state import PATIENCE, Episodes, Normalizer, Validation
from sympol.policies.tree import Tree


def actor(value: float) -> Tree:
    tree = Tree.create(jax.random.key(0), depth=1, num_features=1, num_outputs=2)
    return jax.tree.map(lambda a: jnp.full_like(a, value), tree)


def after(scores: list[float], *, reduce_lr: bool = True) -> list[Validation]:
    """Validations one after the other; the actor of the i-th holds i everywhere."""
    validation, history = Validation.create(actor(-1)), []
    for i, score in enumerate(scores):
        validation = validation.update(jnp.float32(score), jnp.int32(10 * i), actor(i), reduce_lr=reduce_lr)
        history.append(validation)
    return history


def best(validation: Validation) -> float:
    return float(validation.best_actor.leaf_values[0, 0])


def test_the_best_tree_is_kept():
    history = after([-300, -100, -200, -50, -60])
    assert [best(v) for v in history] == [0, 1, 1, 3, 3]
    assert [float(v.best_return) for v in history] == [-300, -100, -100, -50, -50]
    assert [float(v.last_return) for v in history] == [-300, -100, -200, -50, -60]
    assert [int(v.best_timestep) for v in history] == [0, 10, 10, 30, 30]


def test_of_equals_the_later_is_kept_but_is_no_improvement():
    history = after([5, 5, 5])
    assert [best(v) for v in history] == [0, 1, 2]
    assert [int(v.num_bad) for v in history] == [0, 1, 2]


def test_rates_halve_after_five_without_improvement_and_not_before():
    history = after([1] + [0] * (PATIENCE - 1))
    assert float(history[-1].lr_factor) == 1
    history = after([1] + [0] * PATIENCE)
    assert float(history[-1].lr_factor) == 0.5
    history = after([1] + [0] * 2 * PATIENCE)
    assert float(history[-1].lr_factor) == 0.25
    assert PATIENCE == 5


def test_improvement_never_reduces_the_rates():
    """A higher return is better: the published program had this the wrong way round."""
    assert float(after(list(range(-30, 30)))[-1].lr_factor) == 1
    falling = after([-float(i) for i in range(11)])
    assert float(falling[-1].lr_factor) == 0.25
    late = after([0, -1, -1, -1, -1, 1, 0, 0, 0, 0])
    assert float(late[-1].lr_factor) == 1


def test_without_reduce_lr_the_rates_stay():
    assert float(after([1] + [0] * 30, reduce_lr=False)[-1].lr_factor) == 1


def test_a_return_that_is_not_a_number_is_never_the_best():
    history = after([1, np.nan, 2])
    assert [best(v) for v in history] == [0, 0, 2]
    assert [float(v.best_return) for v in history] == [1, 1, 2]


def test_episodes_are_counted_one_environment_at_a_time():
    rng = np.random.default_rng(0)
    reward, done = rng.normal(size=(50, 3)).astype(np.float32), rng.random((50, 3)) < 0.2
    episodes = Episodes.zeros(3).steps(jnp.asarray(reward), jnp.asarray(done))
    returns, lengths, running = [], [], []
    for e in range(3):
        total, length = 0.0, 0
        for t in range(50):
            total, length = total + float(reward[t, e]), length + 1
            if done[t, e]:
                returns.append(total)
                lengths.append(length)
                total, length = 0.0, 0
        running.append((total, length))
    np.testing.assert_allclose(episodes.sum_return, sum(returns), rtol=1e-4, atol=1e-5)
    assert (int(episodes.sum_length), int(episodes.num_ended)) == (sum(lengths), len(lengths))
    np.testing.assert_allclose(episodes.running_return, [r for r, _ in running], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(episodes.running_length, [n for _, n in running])

    reported = episodes.after_report()
    assert (float(reported.sum_return), int(reported.sum_length), int(reported.num_ended)) == (0, 0, 0)
    np.testing.assert_array_equal(reported.running_length, episodes.running_length)


@pytest.mark.parametrize("shape", [(2,), (5, 2), (3, 5, 2)])
def test_the_normaliser_works_on_the_last_axis(shape):
    x = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    shift, scale = np.float32([1, -2]), np.float32([3, 0.5])
    scaled = Normalizer(jnp.asarray(shift), jnp.asarray(scale))(jnp.asarray(x))
    np.testing.assert_array_equal(scaled, (x - shift) * scale)
