"""The evidence of several rollouts: kept in turns, bounded, and enough to find what one rollout hides."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.config import Config
from sympol.algorithms.evidence import MOST_NUMBERS, SAMPLES, Evidence, num_kept
from sympol.algorithms.split_growth import closed, grow
from sympol.policies.tree import MASKED, Tree

SMALL = Config(grow_splits=True, dynamic_rollout=False, num_envs=8, num_steps=128)


@pytest.mark.parametrize(
    ("config", "numbers", "kept"),
    [
        (SMALL, 10, SAMPLES // 1024),
        (SMALL, MOST_NUMBERS // 2048, 2),
        (SMALL, MOST_NUMBERS, 1),
        (dataclasses.replace(SMALL, total_timesteps=1024 * 2 * 24), 10, 2),
        (dataclasses.replace(SMALL, total_timesteps=4096), 10, 1),
        (Config(grow_splits=False, dynamic_rollout=False, num_envs=8, num_steps=128), 10, 1),
        (Config(grow_splits=True, num_envs=8, num_steps=128), 10, 1),
        (Config(grow_splits=True, dynamic_rollout=False, num_envs=32, num_steps=512), 10, 1),
    ],
)
def test_how_many_rollouts_are_kept(config, numbers, kept):
    assert num_kept(config, numbers) == kept


def test_the_newest_rollout_takes_the_place_of_the_oldest():
    config = Config(
        grow_splits=True, dynamic_rollout=False, num_envs=4, num_steps=SAMPLES // 16, total_timesteps=10**6
    )
    evidence, size = Evidence.zeros(config, 1, 2), config.chunk_size
    assert evidence is not None
    assert evidence.x.shape == (4 * size, 1)
    for number in range(1, 7):
        value = float(number)
        evidence = evidence.with_rollout(jnp.full((size, 1), value), jnp.full((size, 2), -value))
        assert bool(evidence.is_new(size)) == (number == 4)
    assert evidence.x[::size, 0].tolist() == [5, 6, 3, 4]
    assert evidence.gradients[::size].tolist() == [[-5, -5], [-6, -6], [-3, -3], [-4, -4]]


def test_several_rollouts_show_what_one_hides():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(SAMPLES, 3)).astype(np.float32)
    side = np.where(x[:, 1] > 0, 0.08, -0.08)[:, None] * np.array([1, -1])
    gradients = (side + rng.normal(size=(SAMPLES, 2))).astype(np.float32)
    tree = closed(Tree.create(jax.random.key(0), depth=3, num_features=3, num_outputs=2))
    grown = jax.jit(grow, static_argnums=4)
    of_one = grown(tree, x, gradients, SAMPLES // 8, 8)
    assert (np.asarray(of_one.thresholds) == MASKED).all()
    of_all = grown(tree, x, gradients, SAMPLES, 8)
    assert np.argmax(of_all.feature_logits[0]) == 1
    assert abs(float(of_all.thresholds[0, 1])) < 0.3
