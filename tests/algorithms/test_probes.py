"""The learner finds the known answer of every probe environment."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

from sympol.algorithms.compiled import Compiled
from sympol.algorithms.config import Config
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import make_loop
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
SHARED: dict[str, Any] = {
    "num_envs": 8,
    "total_timesteps": 300 * 128,
    "dynamic_rollout": False,
    "critic_hidden": (8,),
    "num_eval_episodes": 16,
    "learning_rate_log_std": 0.01,
    "learning_rate_critic": 0.02,
    "lr_end_factor": 0.02,
    "ent_coef": 0.0,
    "gamma": GAMMA,
    "weight_decay": 0.0,
    "normalize_obs": False,
}
OF_ALGORITHM: dict[str, dict[str, Any]] = {
    "ppo": {"num_steps": 16, "minibatch_size": 32, "num_epochs": 4},
    "a2c": {"num_steps": 8},  # one update a rollout: twice as many of half the length
}
OF_POLICY: dict[str, dict[str, Any]] = {
    "tree": {
        "depth": 3,
        "learning_rate_feature_logits": 0.02,
        "learning_rate_thresholds": 0.02,
        "learning_rate_leaf_values": 0.02,
        "threshold_std_init": 0.2,
    },
    "mlp": {"actor_hidden": (8,), "learning_rate_actor": 0.005},
    "sdt": {"depth": 2, "critic": "sdt", "learning_rate_actor": 0.02},
}
ALL = [("ppo", "tree"), ("ppo", "mlp"), ("ppo", "sdt"), ("a2c", "tree"), ("a2c", "mlp")]
EVERYONE = pytest.mark.parametrize("who", ALL, ids="-".join)
"""Who learns: algorithm and policy; the soft tree with a soft tree as its critic."""


def config_of(who: tuple[str, str]) -> Config:
    algorithm, policy = who
    own = {**OF_ALGORITHM[algorithm], **OF_POLICY[policy]}
    return Config.from_dict({"algorithm": algorithm, "policy": policy, **SHARED, **own})


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


@functools.cache
def program(who: tuple[str, str]) -> Compiled:
    """Trains on any of those that are alike."""
    config = config_of(who)

    def train_one(which: Array, seed: Array) -> TrainState:
        loop = make_loop(OneOf(which), config)
        stop, empty = np.int32(config.total_timesteps), loop.template()
        return loop.segment(config.hyperparameters(), seed, empty, np.bool_(True), stop)

    return Compiled(train_one)


def train(who: tuple[str, str], env: Probe, seed: int = 0) -> TrainState:
    if env in ALIKE:
        return program(who)(np.int32(ALIKE.index(env)), np.uint32(seed))
    config = config_of(who)
    loop = make_loop(env, config)
    stop = np.int32(config.total_timesteps)
    given = loop.template()
    return Compiled(loop.segment)(config.hyperparameters(), np.uint32(seed), given, np.bool_(True), stop)


def values(state: TrainState, *observations: list[float]) -> np.ndarray:
    return np.asarray(state.networks.critic(jnp.array(observations)))[:, 0]


def outputs(state: TrainState, *observations: list[float]) -> np.ndarray:
    return np.asarray(state.networks.actor(jnp.array(observations)))


pytestmark = pytest.mark.slow


@EVERYONE
def test_a_constant_value(who):
    np.testing.assert_allclose(values(train(who, ConstantValue()), [0.0, 0.0]), [1], atol=0.02)


@EVERYONE
def test_a_value_that_depends_on_the_observation(who):
    np.testing.assert_allclose(
        values(train(who, ValueOfObservation()), [-1.0, 0.0], [1.0, 0.0]), [-1, 1], atol=0.03
    )


@EVERYONE
def test_a_value_a_step_later_is_discounted(who):
    np.testing.assert_allclose(values(train(who, Discount()), [0.0, 0.0], [1.0, 0.0]), [GAMMA, 1], atol=0.03)


@EVERYONE
def test_a_time_limit_is_no_end(who):
    """1 / (1 − γ) = 5, where five steps' worth would be 3.4 at most."""
    np.testing.assert_allclose(values(train(who, TimeLimit()), [0.0, 0.0]), [1 / (1 - GAMMA)], rtol=0.03)


@EVERYONE
def test_the_better_action(who):
    state = train(who, RewardOfAction())
    assert np.diff(outputs(state, [0.0, 0.0])[:, :2])[0, 0] > 2
    assert float(state.validation.last_return) == 1


@EVERYONE
def test_the_action_that_fits_the_observation(who):
    state = train(who, MatchObservation())
    np.testing.assert_array_equal(outputs(state, [-1.0, 0.0], [1.0, 0.0])[:, :2].argmax(1), [0, 1])
    assert float(state.validation.last_return) == 1
    np.testing.assert_allclose(values(state, [-1.0, 0.0], [1.0, 0.0]), [1, 1], atol=0.15)


@pytest.mark.parametrize("who", ALL[:4], ids="-".join)  # each a program more; the last would tell nothing new
def test_the_continuous_action_that_fits_the_observation(who):
    state = train(who, ContinuousMatch())
    np.testing.assert_allclose(outputs(state, [-0.5], [0.5])[:, 0], [-0.5, 0.5], atol=0.1)
    assert float(state.networks.actor.log_std[0]) < -0.3  # noise only costs here
    assert float(state.validation.last_return) > -0.02


@EVERYONE
def test_two_choices_at_once(who):
    """A tree may keep its first splits and miss one of the two features: one in three does (PPO; nearly one in two
    with A2C), so three try."""
    trained = [train(who, MultiDiscreteMatch(), seed) for seed in range(3)]
    state = max(trained, key=lambda state: float(state.validation.last_return))
    assert float(state.validation.last_return) == 2
    signs = [[a, b] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    chosen = outputs(state, *signs)
    np.testing.assert_array_equal(chosen[:, :2].argmax(1), [0, 0, 1, 1])
    np.testing.assert_array_equal(chosen[:, 2:].argmax(1), [0, 2, 0, 2])


def test_the_probes_are_all_here():
    from tests.envs.probes import PROBES

    assert {*ALIKE, ContinuousMatch()} == set(PROBES)
