"""Training on Gymnasium environments: the same update, fed by the host."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.agents import agent_of
from sympol.algorithms.config import Config
from sympol.algorithms.host_rollouts import HostRollouts
from sympol.algorithms.initialization import host_seed
from sympol.algorithms.rollouts import validation_limit
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import Trainer, make_loop
from sympol.envs.diagnostics import EpisodesCut
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.types import Step

from .programs import begun

CONFIG = Config(
    depth=2,
    num_envs=4,
    num_steps=16,
    total_timesteps=16_384,
    minibatch_size=32,
    num_epochs=4,
    critic_hidden=(8,),
    num_eval_episodes=8,
    learning_rate_feature_logits=0.03,
    learning_rate_thresholds=0.01,
    learning_rate_leaf_values=0.05,
    learning_rate_critic=0.005,
)
CARTPOLE = resolve("CartPole-v1", backend="host")


class SignedReward(gymnasium.Env):
    """Observes a sign and three random numbers, drawn anew each step; action 1 pays the sign. Ends after 8 steps.

    Its space is CartPole's, so that the compiled update is the same.
    """

    observation_space = CARTPOLE.observation_space
    action_space = gymnasium.spaces.Discrete(2, start=3)

    def __init__(self, fails_at: int | None = None, reward: float = 1.0) -> None:
        self.fails_at, self.scale, self.total = fails_at, reward, 0

    def _observe(self) -> np.ndarray:
        self.sign = self.np_random.choice([-1.0, 1.0])
        x = [4.8 * self.sign, *self.np_random.uniform(-0.4, 0.4, 3)]
        return np.float32(x)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.time = 0
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        assert self.action_space.contains(action)
        self.time, self.total = self.time + 1, self.total + 1
        if self.fails_at is not None and self.total > self.fails_at:
            raise RuntimeError("out of order")
        reward = self.scale * (self.sign if action == 4 else -self.sign)
        return self._observe(), reward, False, self.time >= 8, {}


def spec_of(make: Callable[[], gymnasium.Env] = SignedReward) -> EnvSpec:
    return resolve(make)


def train(spec: EnvSpec, cuts: list[int], seed: int = 0, config: Config = CONFIG) -> TrainState:
    trainer = Trainer(spec, config, seed)
    try:
        state = None
        for stop in cuts:
            state = trainer.advance(state, stop)
        assert state is not None
        return state
    finally:
        trainer.close()


def source_of(spec: EnvSpec, config: Config) -> HostRollouts:
    source = make_loop(spec, config.static()).rollouts
    assert isinstance(source, HostRollouts)
    return source


def assert_same_bits(a: Any, b: Any) -> None:
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


@pytest.fixture(scope="module")
def trained() -> TrainState:
    return train(spec_of(), [1024, 2048])


def test_it_learns(trained):
    assert float(trained.validation.last_return) > 7  # of 8; acting at random earns 0
    assert int(trained.timestep) >= 2048
    assert int(trained.episodes.num_ended) > 100


def test_same_seed_same_bits(trained):
    assert_same_bits(train(spec_of(), [1024, 2048]), trained)


def test_another_seed_is_another_training(trained):
    other = train(spec_of(), [1024], seed=1).networks.actor
    assert not np.any(np.asarray(other.thresholds) == np.asarray(trained.networks.actor.thresholds))


def test_a_state_saved_in_between_goes_on_to_the_same_bits(trained):
    """A new process would do the same: nothing is left over from the first trainer but the arrays."""
    first = train(spec_of(), [1024])
    saved = jax.tree.map(lambda a: np.array(a), first)
    trainer = Trainer(spec_of(), CONFIG, 0)
    template = trainer.template()._replace(env_state=saved.env_state)  # whose length differs
    assert jax.tree.map(np.shape, template) == jax.tree.map(np.shape, saved)
    assert_same_bits(trainer.advance(saved, 2048), trained)
    trainer.close()


def test_a_failure_names_the_step_and_leaves_the_last_update():
    """Four copies step together: their 100th step comes in the second rollout, after 64 of 16 steps × 4."""
    trainer = Trainer(spec_of(lambda: SignedReward(fails_at=40)), CONFIG, 0)
    with pytest.raises(EnvironmentFailure, match=r"at training step 160: environment 0 .*out of order"):
        trainer.advance(None, 2048)
    latest: Any = trainer.latest
    assert int(latest.timestep) == 128
    assert int(latest.iteration) == 2
    trainer.close()


def test_a_reward_that_is_not_finite_names_the_step():
    trainer = Trainer(spec_of(lambda: SignedReward(reward=np.nan)), CONFIG, 0)
    with pytest.raises(EnvironmentFailure, match=r"at training step 0: .*reward .*not finite"):
        trainer.advance(None, 2048)
    trainer.close()


@pytest.mark.slow
def test_cartpole_through_gymnasium_learns():
    returns = [train(CARTPOLE, [16_384], seed).validation.last_return for seed in range(3)]
    assert np.mean(returns) > 2 * 22  # what acting at random earns is 22


def test_the_rollout_of_the_host_is_true():
    """Fresh noise at every step, auto-reset without a leak, actions counted from zero."""
    spec = spec_of()
    state, source = begun(spec, CONFIG), source_of(spec, CONFIG)
    state = source.begin_segment(state, 0)
    state, (rollout, after, _) = source.collect(state, None, np.int32(1), jax.random.key(0))
    after = np.asarray(after)
    source.close()
    observation, last = (np.concatenate(a[:2]) for a in (rollout.observation, rollout.last_observation))
    done = np.concatenate(rollout.truncated[:2])
    assert not np.any(rollout.terminated)
    np.testing.assert_array_equal(np.flatnonzero(done[:, 0]), [7, 15, 23, 31])
    following = np.concatenate([observation[1:], after[None]])
    np.testing.assert_array_equal(following[~done], last[~done])
    assert not np.any(following[done][:, 1] == last[done][:, 1])
    numbers = observation[..., 1].ravel()
    assert len(np.unique(numbers)) == len(numbers)  # no two copies, steps or episodes share a seed
    action = np.concatenate(rollout.action[:2])
    assert action.dtype == np.int32
    assert set(np.unique(action)) == {0, 1}
    assert len({tuple(row) for row in action.tolist()}) > 8  # of 16 patterns over four copies
    sign = np.where(action == 1, 1, -1) * np.sign(observation[..., 0])
    np.testing.assert_array_equal(np.concatenate(rollout.reward[:2]), sign)


def test_the_noise_of_the_policy_never_repeats():
    spec = resolve("Pendulum-v1", backend="host")
    config = dataclasses.replace(CONFIG, num_envs=2, depth=1)
    source = source_of(spec, config)
    state = source.begin_segment(begun(spec, config), 0)
    _, experience = source.collect(state, None, np.int32(1), jax.random.key(0))
    actions = np.asarray(experience.rollout.action[:2]).ravel()
    source.close()
    assert len(np.unique(actions)) == len(actions)


class Endless(SignedReward):
    """Pays for its first three steps, and never ends. Or ends by itself after ``length`` steps."""

    def __init__(self, length: int | None = None) -> None:
        super().__init__()
        self.length, self.resets = length, 0

    def reset(self, **options: Any) -> tuple[np.ndarray, dict]:
        self.resets += 1
        return super().reset(**options)

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        observation, *_ = super().step(action)
        return observation, float(self.time <= 3), self.time == self.length, False, {}


def validate(*copies: Endless, **options: Any) -> tuple[list[float], bool, HostRollouts]:
    """The returns of a tree that has learnt nothing."""
    left = iter([Endless() for _ in range(1 + len(copies))])  # to look at, and to train on
    validated = iter(copies)
    spec = resolve(lambda: next(left, None) or next(validated))
    config = dataclasses.replace(CONFIG, num_envs=len(copies), **options)
    state = begun(spec_of(), config)
    source = source_of(spec, config)
    returns, was_cut = source.evaluate(state, 0)
    return returns.tolist(), was_cut, source


def test_where_validation_cuts_an_episode_the_next_is_another():
    """Each of the eight pays 3; were the second of a copy the first going on, it would pay nothing."""
    copies = [Endless() for _ in range(4)]
    returns, was_cut, source = validate(*copies)
    assert (returns, was_cut, source.limit) == ([3.0] * 8, True, 1_000)
    assert [copy.total for copy in copies] == [2_000] * 4  # and not 10,000 an episode
    assert [copy.resets for copy in copies] == [2] * 4


def test_an_episode_that_ends_at_the_limit_is_not_cut_and_who_has_played_enough_rests():
    copies = [Endless(1_000), Endless(10), Endless(10)]
    returns, was_cut, _ = validate(*copies, num_eval_episodes=6)
    assert (returns, was_cut) == ([3.0] * 6, False)
    assert [copy.total for copy in copies] == [2_000, 20, 20]


@pytest.mark.parametrize("num_episodes", [1, 3, 5])
def test_as_many_episodes_are_validated_as_were_asked_for(num_episodes):
    copies = [Endless(10) for _ in range(4)]
    returns, _, _ = validate(*copies, num_eval_episodes=num_episodes)
    assert returns == [3.0] * num_episodes
    played = [len(range(i, num_episodes, min(4, num_episodes))) for i in range(min(4, num_episodes))]
    copies = copies[: len(played)]  # no more than needed were opened
    assert [copy.resets for copy in copies] == played
    assert [copy.total for copy in copies] == [10 * number for number in played]


class Lottery(SignedReward):
    """Pays what chance drew at the reset; chance is drawn once more at each step, of which there are 1 to 5."""

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        result = super().reset(seed=seed)
        self.prize, self.length = self.np_random.uniform(), self.np_random.integers(1, 6)
        return result

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        observation, *_ = super().step(action)
        return observation, self.prize, self.time == self.length, False, {}


@pytest.mark.parametrize("spec", [spec_of(Lottery), resolve("CartPole-v1"), resolve("LunarLander-v3")])
def test_validations_are_paired(spec):
    """The first episodes are the same, however many are played, by however many copies, at whatever time."""

    def returns(num_envs: int, num_episodes: int | None, timestep: int = 0) -> list[float]:
        config = dataclasses.replace(CONFIG, num_envs=num_envs, num_eval_episodes=9)
        source = make_loop(spec if spec.env is None else spec.env, config.static()).rollouts
        state = begun(spec if spec.env is None else spec.env, config)
        state = state._replace(timestep=jnp.int32(timestep))
        result = source.evaluate(state, np.uint32(0), num_episodes)[0].tolist()
        source.close()
        return result

    every = returns(4, None)
    assert len(every) == 9
    assert len(set(every)) > 1
    for num_envs, num_episodes in ((4, 9), (4, 2), (16, 5), (1, 3)):
        assert returns(num_envs, num_episodes, timestep=512) == every[:num_episodes]


@pytest.mark.parametrize(
    ("declared", "total", "num_evals", "episodes", "limit"),
    [
        (None, 16_384, 20, 32, 1_000),  # no less, however short the training
        (None, 1_000_000, 20, 32, 1_562),  # 50,000 steps between two validations, and 50,000 of one
        (None, 100_000_000, 20, 32, 10_000),
        (500, 1_000_000, 20, 32, 500),
        (50_000, 16_384, 20, 32, 50_000),
    ],
)
def test_where_validation_cuts(declared, total, num_evals, episodes, limit):
    config = Config(total_timesteps=total, num_evals=num_evals)
    assert validation_limit(declared, config, episodes) == limit


def test_a_training_says_once_that_validation_cuts():
    options: dict[str, Any] = {"num_evals": 3, "num_eval_episodes": 4, "total_timesteps": 256}
    config = dataclasses.replace(CONFIG, **options)
    agent = agent_of(resolve(Endless), config, 0)
    with pytest.warns(EpisodesCut) as said:
        agent.learn(progress_bar=False)
    assert [str(warning.message).split(";")[0] for warning in said] == [
        "Endless did not end an episode within 1,000 steps, so validation cuts its episodes there and counts what "
        "they earned until then"
    ]
    assert agent.state is not None
    assert float(agent.state.validation.last_return) == 3.0


class EndlessInJax:
    """Observes the time and never ends; pays for the first three steps."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (1,))
    action_space = gymnasium.spaces.Discrete(2)
    max_episode_steps = None

    def reset(self, key: Any) -> tuple[Any, Any]:
        return jnp.zeros(1), jnp.zeros(1)

    def step(self, key: Any, state: Any, action: Any) -> tuple[Any, Step]:
        reward = jnp.where(state[0] < 3, 1.0, 0.0)
        return state + 1, Step(state + 1, reward, jnp.bool_(False), jnp.bool_(False))


def test_validation_in_the_compiled_program_cuts_as_early_and_says_so():
    options: dict[str, Any] = {"num_evals": 2, "num_eval_episodes": 4, "total_timesteps": 256}
    agent = agent_of(resolve(EndlessInJax()), dataclasses.replace(CONFIG, **options), 0)
    with pytest.warns(EpisodesCut, match="EndlessInJax did not end an episode within 1,000 steps") as said:
        agent.learn(progress_bar=False)
    assert len(said) == 1
    assert agent.state is not None
    assert float(agent.state.validation.last_return) == 3.0


def test_host_seeds_never_meet():
    seeds = {
        host_seed(seed, purpose, timestep)
        for seed in range(20)
        for purpose in ("init", "train", "validation")
        for timestep in (0, 64, 128, 4096)
    }
    assert len(seeds) == 20 * 3 * 4
    assert all(0 <= seed < 2**63 for seed in seeds)
