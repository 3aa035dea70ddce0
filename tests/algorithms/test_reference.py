"""The compiled program against the plain Python loop, from the first rollout to one eight times as long."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.config import Config
from sympol.algorithms.state import PATIENCE, TrainState
from sympol.algorithms.trainer import make_loop
from sympol.envs.classic.cartpole import CartPole
from sympol.policies.distributions import distribution_of
from tests.algorithms.programs import CARTPOLE, CONFIG, segment_of
from tests.algorithms.reference import TREE, Reference
from tests.envs.probes import ContinuousMatch

SEED = 3


@functools.cache
def begun(env: Any, config: Config) -> TrainState:
    """The state of a training that has not taken a step."""
    segment, empty = segment_of(env, config)
    state = segment(config.hyperparameters(), np.uint32(SEED), empty, np.bool_(True), np.int32(0))
    assert int(state.iteration) == 0
    return state


def run_both(
    env: Any, config: Config, eighth: int, num_iterations: int, lr_factor: float = 1.0
) -> tuple[TrainState, Reference]:
    """Both for some iterations from a fresh state in the given eighth of the training, after plateaus or none."""
    segment, _ = segment_of(env, config)
    start = config.total_timesteps * eighth // 8
    state = begun(env, config)._replace(timestep=jnp.int32(start))
    state = state._replace(validation=state.validation._replace(lr_factor=jnp.float32(lr_factor)))
    hyper = config.hyperparameters()
    reference = Reference(env, distribution_of(env.action_space), config, hyper, SEED, state)
    reference.lr_factor = lr_factor
    for _ in range(num_iterations):
        reference.iterate()
    state = segment(hyper, np.uint32(SEED), state, np.bool_(False), np.int32(reference.timestep))
    assert int(state.timestep) == reference.timestep
    assert int(state.iteration) == num_iterations
    return state, reference


def adam_count(state: TrainState) -> set[int]:
    """Optimiser steps, as Adam counted them for each group."""
    found = jax.tree_util.tree_leaves_with_path(state.opt_state)
    return {int(leaf) for path, leaf in found if jax.tree_util.keystr(path).endswith(".count")}


def assert_same(state: TrainState, reference: Reference, atol: float = 2e-5) -> None:
    np.testing.assert_allclose(state.normalizer.shift, reference.shift, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(state.normalizer.scale, reference.scale, rtol=1e-4)
    np.testing.assert_allclose(state.observation, np.stack(reference.observations), rtol=1e-4, atol=1e-5)
    for i, name in enumerate((*TREE, "log_std")):
        ours = getattr(state.networks.actor, name)
        np.testing.assert_allclose(ours, reference.params["actor"][i], rtol=1e-4, atol=atol, err_msg=name)
    ours = [leaf for leaf in jax.tree.leaves(state.networks.critic) if leaf.size]
    for ours_leaf, theirs in zip(ours, reference.params["critic"], strict=True):
        np.testing.assert_allclose(ours_leaf, theirs, rtol=1e-4, atol=atol, err_msg="critic")
    assert adam_count(state) == {reference.num_updates}


@pytest.mark.slow
@pytest.mark.parametrize(("eighth", "num_iterations"), [(0, 4), (2, 2)])
def test_cartpole_as_the_plain_loop_trains_it(eighth, num_iterations):
    """Terminations, time limits, a warm-up of the scale, a mean of 2^k micro-batches for each update."""
    state, reference = run_both(CARTPOLE, CONFIG, eighth, num_iterations)
    assert reference.timestep - CONFIG.total_timesteps * eighth // 8 == num_iterations * 32 * 2**eighth
    assert reference.num_updates == (num_iterations - 1) * CONFIG.num_epochs * CONFIG.num_minibatches
    assert_same(state, reference)
    before = begun(CARTPOLE, CONFIG).networks.actor
    for name in TREE:
        assert np.any(np.abs(getattr(before, name) - getattr(state.networks.actor, name)) > 1e-3)
    np.testing.assert_allclose(state.validation.last_return, reference.validate(), rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("eighth", "num_iterations"), [(0, 3), (2, 1)])
def test_ablations_as_the_plain_loop_trains_them(eighth, num_iterations):
    """A tree critic, no accumulation, raw advantages, continuous actions, every schedule, clipped gradients."""
    env = ContinuousMatch()
    config = Config(
        depth=2,
        num_envs=2,
        num_steps=16,
        total_timesteps=8 * 4 * 32,
        minibatch_size=8,
        num_epochs=2,
        num_eval_episodes=2,
        critic="tree",
        trust_bounds=True,
        dynamic_batch=False,
        norm_adv=False,
        surrogate="softsign",
        lr_end_factor=0.2,
        ent_end_factor=0.5,
        max_grad_norm=0.3,
        log_std_init=0.3,
        learning_rate_log_std=0.01,
        reward_scale=0.5,
        weight_decay=0.2,
    )
    state, reference = run_both(env, config, eighth, num_iterations, lr_factor=0.5)
    assert reference.num_updates == num_iterations * config.num_epochs * config.num_minibatches * 2**eighth
    assert_same(state, reference)
    np.testing.assert_allclose(state.validation.last_return, reference.validate(), rtol=1e-3)


def test_the_switches_change_what_is_compiled():
    """Growth off is one chunk of full size; the program then has a single stage."""
    config = Config(dynamic_rollout=False, num_steps=32, num_envs=2, depth=1, total_timesteps=10_000)
    empty = make_loop(CartPole(), config).template()
    assert config.max_stage == 0
    assert empty.observation.shape == (2, 4)
    tree = make_loop(CartPole(), Config(critic="tree", depth=3)).template().networks
    assert tree.critic.thresholds.shape == tree.actor.thresholds.shape == (7, 4)
    assert tree.critic.leaf_values.shape == (8, 1)


@pytest.mark.parametrize("reduce_lr", [False, True])
def test_reduce_lr_is_one_switch(reduce_lr):
    config = dataclasses.replace(CONFIG, reduce_lr=reduce_lr)
    state = begun(CARTPOLE, CONFIG)
    for _ in range(PATIENCE):
        state = make_loop(CARTPOLE, config).record(state, jnp.float32(-1))
    assert float(state.validation.lr_factor) == (0.5 if reduce_lr else 1)
