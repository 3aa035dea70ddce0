"""envpool's LunarLander against Gymnasium's: the same policy earns the same and flies as long.

Their random numbers differ, so the comparison is one of distributions: Welch's test of the means and
Kolmogorov and Smirnov's of the distributions, over two hundred episodes each. The seeds are fixed, so a test
that passes passes again. Where nothing is random, in a fall, the comparison is exact; so is what can be said of
every row, in tests/envs/test_pool.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import envpool  # noqa: F401  (without it there is nothing to test, and CI must not pass)
import numpy as np
import pytest
from scipy import stats

from sympol.envs.pool import PoolEnvs
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec

NUM_ENVS, EPISODES_EACH = 50, 4
LEVEL = 0.01
"""Of each single test."""

DISCRETE, CONTINUOUS = "LunarLander-v3", "LunarLanderContinuous-v3"
Policy = Callable[[np.ndarray, np.random.Generator], np.ndarray]


class Played(NamedTuple):
    returns: np.ndarray
    lengths: np.ndarray


def thrust(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much to push upwards and to which side, by Gymnasium's own heuristic, which lands."""
    lean = np.clip(0.5 * x[:, 0] + 1.0 * x[:, 2], -0.4, 0.4)
    turn = 0.5 * (lean - x[:, 4]) - x[:, 5]
    lift = 0.5 * (0.55 * np.abs(x[:, 0]) - x[:, 1]) - 0.5 * x[:, 3]
    landed = x[:, 6:].any(axis=1)
    return np.where(landed, -0.5 * x[:, 3], lift), np.where(landed, 0, turn)


def heuristic(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    lift, turn = thrust(x)
    side = np.where(np.abs(turn) > 0.05, np.where(turn < 0, 3, 1), 0)
    return np.where((lift > np.abs(turn)) & (lift > 0.05), 2, side).astype(np.int32)


def heuristic_continuous(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    lift, turn = thrust(x)
    return np.clip(np.stack([lift * 20 - 1, -turn * 20], axis=1), -1, 1).astype(np.float32)


def at_random(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 4, len(x)).astype(np.int32)


def at_random_continuous(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, (len(x), 2)).astype(np.float32)


def always(*action: float) -> Policy:
    """One engine, or none: what differs from episode to episode is only how it starts."""
    return lambda x, rng: np.tile(np.float32(action), (len(x), 1))


def choose(action: int) -> Policy:
    return lambda x, rng: np.full(len(x), action, np.int32)


def play(spec: EnvSpec, policy: Policy) -> Played:
    """Every copy plays the same number of episodes; otherwise the short ones would be counted more often."""
    rng = np.random.default_rng(0)
    envs: Any = spec.host_envs(NUM_ENVS)
    observation = envs.reset(5)
    total, length, played = np.zeros(NUM_ENVS), np.zeros(NUM_ENVS, int), np.zeros(NUM_ENVS, int)
    returns, lengths = [], []
    while np.any(wanted := played < EPISODES_EACH):
        step, observation = envs.step(policy(observation, rng), wanted)
        total, length = total + step.reward, length + 1
        done = (step.terminated | step.truncated) & wanted
        returns += total[done].tolist()
        lengths += length[done].tolist()
        total, length, played = np.where(done, 0, total), np.where(done, 0, length), played + done
    envs.close()
    return Played(np.array(returns), np.array(lengths))


def p_values(a: Played, b: Played) -> dict[str, float]:
    return {
        "mean return": stats.ttest_ind(a.returns, b.returns, equal_var=False).pvalue,
        "mean length": stats.ttest_ind(a.lengths, b.lengths, equal_var=False).pvalue,
        "returns": stats.ks_2samp(a.returns, b.returns).pvalue,
        "lengths": stats.ks_2samp(a.lengths, b.lengths).pvalue,
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "policy"),
    [
        pytest.param(DISCRETE, at_random, id="at random"),
        pytest.param(DISCRETE, heuristic, id="heuristic"),
        *(pytest.param(DISCRETE, choose(action), id=f"always {action}") for action in (2, 3)),
        pytest.param(CONTINUOUS, at_random_continuous, id="continuous at random"),
        pytest.param(CONTINUOUS, heuristic_continuous, id="continuous heuristic"),
        pytest.param(CONTINUOUS, always(0.3, 0.1), id="continuous, a weak main engine"),
        pytest.param(CONTINUOUS, always(-0.5, -0.8), id="continuous, one side"),
    ],
)
def test_the_same_policy_earns_the_same(name, policy):
    ours = play(resolve(name, backend="envpool"), policy)
    theirs = play(resolve(name, backend="host"), policy)
    assert all(p > LEVEL for p in p_values(ours, theirs).values()), p_values(ours, theirs)


class Dice:
    """Gymnasium's random numbers, given: flat ground, this first push, engines that do not stray."""

    def __init__(self, push: tuple[float, ...]) -> None:
        self.numbers = [*push]

    def uniform(self, low: float, high: float, size: Any = None) -> Any:
        if size is not None:
            return np.zeros(size)
        return self.numbers.pop(0) if self.numbers else 0.0


def start(*push: float) -> tuple[Any, np.ndarray]:
    env: Any = resolve(DISCRETE).make_host()
    env.unwrapped.np_random = Dice(push)
    return env, env.reset()[0]


def test_falling_freely_they_agree_number_by_number():
    """Engines stray at random, and the ground differs; what is left is a fall, from the same first push."""
    envs = PoolEnvs(DISCRETE, 8)
    first = envs.reset(0)
    rows = [envs.step(np.zeros(8, np.int32))[0] for _ in range(100)]
    still, pushed = start(0, 0)[1][2:4], start(1000, 1000)[1][2:4]
    for copy in range(8):
        env, observation = start(*(1000 * (first[copy, 2:4] - still) / (pushed - still)).tolist())
        x, num_steps = first[copy], 0
        while x[1] > 0.5:  # well above the highest ground
            np.testing.assert_allclose(observation, x, rtol=0, atol=2e-5)
            observation, reward, *_ = env.step(0)
            assert abs(float(reward) - rows[num_steps].reward[copy]) < 2e-3
            x, num_steps = rows[num_steps].observation[copy], num_steps + 1
        assert num_steps > 20
