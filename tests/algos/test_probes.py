"""The learner finds the known answer of every probe environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from sympol.algos.config import Config
from sympol.algos.segment import make_segment
from sympol.algos.state import TrainState
from tests.envs.probes import (
    ConstantValue,
    ContinuousMatch,
    Discount,
    MatchObservation,
    MultiDiscreteMatch,
    Probe,
    ProbeState,
    RewardOfAction,
    TimeLimit,
    ValueOfObservation,
)

GAMMA = 0.8
CONFIG = Config(
    depth=3,
    num_envs=8,
    num_steps=16,
    total_timesteps=300 * 128,
    dynamic_rollout=False,
    minibatch_size=32,
    num_epochs=4,
    critic_hidden=(8,),
    num_eval_episodes=16,
    learning_rate_feature_logits=0.02,
    learning_rate_thresholds=0.02,
    learning_rate_leaf_values=0.02,
    learning_rate_log_std=0.01,
    learning_rate_critic=0.02,
    lr_end_factor=0.02,
    ent_coef=0.0,
    gamma=GAMMA,
    weight_decay=0.0,
    normalize_obs=False,
    threshold_std_init=0.2,
)
ALIKE: tuple[Probe, ...] = (
    ConstantValue(),
    ValueOfObservation(),
    Discount(),
    TimeLimit(),
    RewardOfAction(),
    MatchObservation(),
    MultiDiscreteMatch(),
)
"""In the shape of the last one: a second feature that is zero, a second component of the action that is idle."""


@dataclass(frozen=True, eq=False)
class OneOf:
    """Probes behind one switch, which may be traced: one compiled program for all of them."""

    which: Any
    max_episode_steps: int = 1000

    @property
    def observation_space(self) -> Any:
        return ALIKE[-1].observation_space

    @property
    def action_space(self) -> Any:
        return ALIKE[-1].action_space

    def reset(self, key: Array) -> Any:
        def branch(probe: Probe) -> Any:
            return lambda key: _wide(probe.reset(key))

        state = jax.lax.switch(self.which, [branch(probe) for probe in ALIKE], key)
        return state, state.observation

    def step(self, key: Array, state: Any, action: Array) -> Any:
        def branch(probe: Probe) -> Any:
            width = probe.observation_space.shape[0]

            def step(key: Array, state: Any, action: Array) -> Any:
                narrow = state._replace(observation=state.observation[:width])
                after, result = probe.step(key, narrow, action[0] if width == 1 else action)
                after = _wide((after, after.observation))
                return after, result._replace(observation=after.observation)

            return step

        return jax.lax.switch(self.which, [branch(probe) for probe in ALIKE], key, state, action)


def _wide(begun: tuple[ProbeState, Array]) -> ProbeState:
    state, observation = begun
    return state._replace(observation=jnp.zeros(2).at[: observation.shape[0]].set(observation))


@jax.jit
def train_one(which, seed) -> TrainState:
    segment, empty = make_segment(OneOf(which), CONFIG)
    return segment(CONFIG.hyperparameters(), seed, empty, np.bool_(True), np.int32(CONFIG.total_timesteps))


def train(env: Probe, seed: int = 0) -> TrainState:
    if env in ALIKE:
        return train_one(np.int32(ALIKE.index(env)), np.uint32(seed))
    segment, empty = make_segment(env, CONFIG)
    stop = np.int32(CONFIG.total_timesteps)
    return jax.jit(segment)(CONFIG.hyperparameters(), np.uint32(seed), empty, np.bool_(True), stop)


def values(state: TrainState, *observations: list[float]) -> np.ndarray:
    return np.asarray(state.networks.critic(jnp.array(observations)))[:, 0]


def outputs(state: TrainState, *observations: list[float]) -> np.ndarray:
    return np.asarray(state.networks.actor(jnp.array(observations)))


pytestmark = pytest.mark.slow


def test_a_constant_value():
    np.testing.assert_allclose(values(train(ConstantValue()), [0.0, 0.0]), [1], atol=0.02)


def test_a_value_that_depends_on_the_observation():
    np.testing.assert_allclose(
        values(train(ValueOfObservation()), [-1.0, 0.0], [1.0, 0.0]), [-1, 1], atol=0.03
    )


def test_a_value_a_step_later_is_discounted():
    np.testing.assert_allclose(values(train(Discount()), [0.0, 0.0], [1.0, 0.0]), [GAMMA, 1], atol=0.03)


def test_a_time_limit_is_no_end():
    """1 / (1 − γ) = 5, where five steps' worth would be 3.4 at most."""
    np.testing.assert_allclose(values(train(TimeLimit()), [0.0, 0.0]), [1 / (1 - GAMMA)], rtol=0.03)


def test_the_better_action():
    state = train(RewardOfAction())
    assert np.diff(outputs(state, [0.0, 0.0])[:, :2])[0, 0] > 2
    assert float(state.validation.last_return) == 1


def test_the_action_that_fits_the_observation():
    state = train(MatchObservation())
    np.testing.assert_array_equal(outputs(state, [-1.0, 0.0], [1.0, 0.0])[:, :2].argmax(1), [0, 1])
    assert float(state.validation.last_return) == 1
    np.testing.assert_allclose(values(state, [-1.0, 0.0], [1.0, 0.0]), [1, 1], atol=0.15)


def test_the_continuous_action_that_fits_the_observation():
    state = train(ContinuousMatch())
    np.testing.assert_allclose(outputs(state, [-0.5], [0.5])[:, 0], [-0.5, 0.5], atol=0.1)
    assert float(state.networks.actor.log_std[0]) < -0.3  # noise only costs here
    assert float(state.validation.last_return) > -0.02


def test_two_choices_at_once():
    """A tree may keep its first splits and miss one of the two features: one in eight does, so three try."""
    trained = [train(MultiDiscreteMatch(), seed) for seed in range(3)]
    state = max(trained, key=lambda state: float(state.validation.last_return))
    assert float(state.validation.last_return) == 2
    signs = [[a, b] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    chosen = outputs(state, *signs)
    np.testing.assert_array_equal(chosen[:, :2].argmax(1), [0, 0, 1, 1])
    np.testing.assert_array_equal(chosen[:, 2:].argmax(1), [0, 2, 0, 2])


def test_the_probes_are_all_here():
    from tests.envs.probes import PROBES

    assert {*ALIKE, ContinuousMatch()} == set(PROBES)
