"""Gymnasium's vector environments: every way of resetting gives the same experience."""

from __future__ import annotations

import dataclasses
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

import sympol
from sympol.algorithms.host_rollouts import HostRollouts
from sympol.algorithms.trainer import Trainer, make_loop
from sympol.envs.registry import resolve
from sympol.envs.spaces import Features
from sympol.envs.vector_envs import GymnasiumVectorEnvs

from ..algorithms.programs import begun
from ..algorithms.test_host_training import CARTPOLE, CONFIG

MODES = list(AutoresetMode)


class Counter(gymnasium.Env):
    """Observes episode, step and number of the copy; odd episodes terminate, even ones are truncated."""

    observation_space = CARTPOLE.observation_space
    action_space = CARTPOLE.action_space

    def __init__(self, copy: int = 0) -> None:
        self.copy, self.episode = copy, 0

    def _observe(self) -> np.ndarray:
        return np.float32([self.episode, self.time, self.copy, 0])

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.episode, self.time = self.episode + 1, 0
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        self.time += 1
        over, odd = self.time == 3 + self.copy, self.episode % 2 == 1
        return self._observe(), float(self.time), over and odd, over and not odd, {}


def vector(mode: AutoresetMode, copies: int = 3) -> VectorEnv:
    return SyncVectorEnv([lambda i=i: Counter(i) for i in range(copies)], autoreset_mode=mode)


@pytest.mark.parametrize("mode", MODES)
def test_the_last_observation_is_the_true_one_and_resets_are_told_apart(mode):
    envs = GymnasiumVectorEnvs(vector(mode), Features.of(Counter.observation_space))
    observation, skipped = envs.reset(0), 0
    for _ in range(20):
        step, following = envs.step(np.zeros(3, np.int32))
        for i in range(3):
            episode, time = observation[i][:2]
            if envs.skipped is not None and envs.skipped[i]:
                skipped += 1
                assert (step.reward[i], bool(step.terminated[i] | step.truncated[i])) == (0, False)
                assert following[i].tolist() == [episode + 1, 0, i, 0]
                continue
            ended = time + 1 == 3 + i
            assert step.observation[i].tolist() == [episode, time + 1, i, 0]
            assert step.reward[i] == time + 1
            assert step.terminated[i] == (ended and episode % 2 == 1)
            assert step.truncated[i] == (ended and episode % 2 == 0)
            if ended and mode is not AutoresetMode.NEXT_STEP:
                assert following[i].tolist() == [episode + 1, 0, i, 0]
        observation = following
    assert (skipped > 0) == (mode is AutoresetMode.NEXT_STEP)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("has_single", [True, False])
def test_it_is_trained_on_and_evaluated(mode, has_single):
    """On single environments where they can be made, else on the vector environment."""

    def make() -> VectorEnv:
        envs = vector(mode, 2)
        if not has_single:
            del envs.env_fns
        return envs

    spec = resolve(make)
    assert spec.vector is not None
    assert (spec.vector.num_envs, spec.vector.has_single, spec.has_one_copy) == (2, has_single, False)
    config = dataclasses.replace(CONFIG, num_envs=2, num_steps=16, num_eval_episodes=3)
    trainer = Trainer(spec, config, 0)
    state = trainer.advance(trainer.advance(None, 128), 256)
    trainer.close()
    assert int(state.timestep) == 256
    ended = int(state.episodes.num_ended)  # in the second half, of 64 steps each
    assert 25 < ended < 45
    assert 3 * ended < int(state.episodes.sum_length) < 4 * ended
    assert float(state.validation.last_return) == pytest.approx(6 if has_single else (6 + 10 + 6) / 3)
    with pytest.raises(
        ValueError, match="num_envs must be 2, the number of copies of the vector environment"
    ):
        spec.host_envs(3)
    with pytest.raises(ValueError, match="env_workers must be 0 for"):
        spec.stepped_by(2)


def test_an_agent_takes_the_number_of_copies_from_the_vector_environment():
    envs = gymnasium.make_vec("CartPole-v1", num_envs=3, vectorization_mode="vector_entry_point")
    agent = sympol.PPO("tree", envs, depth=2, total_timesteps=256, num_evals=1, num_eval_episodes=2)
    assert agent.config.num_envs == 3
    agent.learn(progress_bar=False)
    returns, _ = sympol.evaluate_policy(agent, agent.spec, 2, return_episode_rewards=True)
    assert min(returns) >= 8
    envs.reset(seed=0)  # the user's own object is still open
    envs.close()


def test_a_reset_counts_as_no_step_and_repeats_the_end_of_the_episode():
    config = dataclasses.replace(CONFIG, num_envs=3)
    spec = resolve(lambda: vector(AutoresetMode.NEXT_STEP))
    source = make_loop(spec, config.static()).rollouts
    assert isinstance(source, HostRollouts)
    state = source.begin_segment(begun(spec, config), 0)
    state, (rollout, _, _) = source.collect(state, None, np.int32(0), jax.random.key(0))
    source.close()
    reward, ended = rollout.reward[0], (rollout.terminated | rollout.truncated)[0]
    for i in range(3):
        length = 3 + i
        expected = ([*range(1, length + 1), length] * 20)[: len(reward)]
        assert reward[:, i].tolist() == expected
        over = ([*[False] * (length - 1), True, True] * 20)[: len(reward)]
        assert ended[:, i].tolist() == over
    whole = sum(len(reward) // (3 + i + 1) + ((len(reward) % (3 + i + 1)) == 3 + i) for i in range(3))
    assert int(state.episodes.num_ended) == whole
