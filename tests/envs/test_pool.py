"""envpool's copies behind the interface of `HostEnvs`: every row is experience, seeded and in its place."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import envpool  # noqa: F401  (without it there is nothing to test, and CI must not pass)
import numpy as np
import pytest

from sympol.envs import pool
from sympol.envs.host import EnvironmentFailure, HostEnvs
from sympol.envs.pool import TASKS, PoolEnvs
from sympol.envs.registry import MissingExtra, register, resolve

NUM_ENVS = 6
CONTINUOUS = "LunarLanderContinuous-v3"


def random_actions(task: str, num_steps: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    if task == CONTINUOUS:
        return rng.uniform(-1, 1, (num_steps, NUM_ENVS, 2)).astype(np.float32)
    return rng.integers(0, 4, (num_steps, NUM_ENVS)).astype(np.int32)


def roll(task: str, seed: int, num_steps: int = 300) -> tuple[np.ndarray, ...]:
    """Observations, rewards, terminated, truncated, last observations, each ``[num_steps, envs, …]``."""
    envs, rows = PoolEnvs(task, NUM_ENVS), []
    observation = envs.reset(seed)
    for action in random_actions(task, num_steps):
        step, following = envs.step(action)
        rows.append((observation, step.reward, step.terminated, step.truncated, step.observation))
        observation = following
    envs.close()
    return tuple(np.stack(column) for column in zip(*rows, strict=True))


@pytest.mark.parametrize("task", TASKS.values())
def test_the_seed_decides_and_the_threads_do_not(task, monkeypatch):
    first = roll(task, 7)
    for cores in (1, 4):
        monkeypatch.setattr("os.sched_getaffinity", lambda pid, cores=cores: set(range(cores)))
        again = roll(task, 7)
        assert all(a.tobytes() == b.tobytes() for a, b in zip(first, again, strict=True))
    other = roll(task, 8)
    speed = np.stack([first[0][0, :, 2], other[0][0, :, 2]]).ravel()
    assert len(np.unique(speed)) == 2 * NUM_ENVS  # no two copies or seeds share one


def shaping(x: np.ndarray) -> np.ndarray:
    """What Gymnasium's reward is the difference of."""
    x = x.astype(np.float64)
    far, fast = np.hypot(x[..., 0], x[..., 1]), np.hypot(x[..., 2], x[..., 3])
    return -100 * (far + fast + np.abs(x[..., 4])) + 10 * (x[..., 6] + x[..., 7])


def fuel(task: str, action: np.ndarray) -> np.ndarray:
    if task != CONTINUOUS:
        return np.array([0, 0.03, 0.3, 0.03])[action]
    main, side = action[..., 0].astype(np.float64), np.abs(action[..., 1]).astype(np.float64)
    return 0.3 * (main > 0) * (main + 1) / 2 + 0.03 * (side > 0.5) * side


@pytest.mark.parametrize("task", TASKS.values())
def test_every_row_is_experience(task):
    """The reward of each row follows from its own two observations and its own action, across ends of episodes."""
    num_steps = 1000
    observation, reward, terminated, truncated, last = roll(task, 1, num_steps)
    assert not truncated.any()
    assert terminated.sum() > 30
    expected = shaping(last) - shaping(observation) - fuel(task, random_actions(task, num_steps))
    np.testing.assert_allclose(reward[~terminated], expected[~terminated], rtol=0, atol=1e-3)
    assert set(np.unique(reward[terminated])) <= {-100, 100}
    following = observation[1:]
    same = ~terminated[:-1]
    np.testing.assert_array_equal(following[same], last[:-1][same])
    first = following[~same]
    assert np.all((first[:, 1] > 1.3) & (first[:, 1] < 1.5))  # they start at the top, in the middle
    assert np.all(np.abs(first[:, 0]) < 0.05)
    assert len(np.unique(first[:, 2])) == len(first)


def hover(x: np.ndarray) -> np.ndarray:
    """Stay in the middle of the air."""
    lean = np.clip(0.5 * x[:, 0] + 1.0 * x[:, 2], -0.4, 0.4)
    turn = 0.5 * (lean - x[:, 4]) - x[:, 5]
    lift = 0.5 * (1 + 0.5 * np.abs(x[:, 0]) - x[:, 1]) - 0.5 * x[:, 3]
    action = np.where(np.abs(turn) > 0.05, np.where(turn < 0, 3, 1), 0)
    return np.where((lift > np.abs(turn)) & (lift > 0.05), 2, action).astype(np.int32)


def test_the_clock_truncates_and_does_not_terminate():
    envs = PoolEnvs("LunarLander-v3", NUM_ENVS)
    observation = envs.reset(0)
    for _ in range(999):
        step, observation = envs.step(hover(observation))
        assert not step.terminated.any()
        assert not step.truncated.any()
    step, observation = envs.step(hover(observation))
    envs.close()
    assert step.truncated.all()
    assert not step.terminated.any()
    assert np.all(np.abs(step.reward) < 20)
    assert np.all(np.abs(step.observation[:, 5]) < 1)
    assert len(np.unique(observation[:, 2])) == NUM_ENVS  # all have begun anew, each in its own way
    assert not np.any(observation[:, :6] == step.observation[:, :6])


def test_copies_that_are_not_wanted_need_not_step():
    """And the others do as they would have done."""
    task, wanted = "LunarLander-v3", np.arange(NUM_ENVS) % 3 == 1
    some, every = PoolEnvs(task, NUM_ENVS), PoolEnvs(task, NUM_ENVS)
    np.testing.assert_array_equal(some.reset(3), every.reset(3))
    for action in random_actions(task, 200):
        (step, after), (whole, whole_after) = some.step(action, wanted), every.step(action)
        for part, full in zip((*step, after), (*whole, whole_after), strict=True):
            np.testing.assert_array_equal(np.asarray(part)[wanted], np.asarray(full)[wanted])
        assert not np.any(np.asarray(step.terminated)[~wanted])


class Broken:
    """A pool whose fourth copy is out of order."""

    def __init__(self, observation: float = 0, reward: float = 0) -> None:
        self.observation, self.reward = np.zeros((NUM_ENVS, 8)), np.zeros(NUM_ENVS)
        self.observation[3, 2], self.reward[3] = observation, reward

    def reset(self) -> tuple[np.ndarray, dict]:
        return self.observation, {}

    def step(self, actions: np.ndarray) -> tuple[Any, ...]:
        no = np.zeros(NUM_ENVS, bool)
        return self.observation, self.reward, no, no, {}


@pytest.mark.parametrize(("kind", "word"), [("observation", "an observation"), ("reward", "a reward")])
def test_what_is_not_finite_names_the_copy(kind, word, monkeypatch):
    envs = PoolEnvs("LunarLander-v3", NUM_ENVS)
    sound, broken = Broken(), Broken(**{kind: np.nan})
    monkeypatch.setattr(pool, "make_pool", lambda *_: sound)
    envs.reset(0)
    sound.step = broken.step
    with pytest.raises(EnvironmentFailure, match=f"environment 3 returned {word} that is not finite"):
        envs.step(np.zeros(NUM_ENVS, np.int32))


@pytest.mark.parametrize("name", TASKS)
def test_it_is_taken_where_it_is_installed(name, monkeypatch):
    spec = resolve(name)
    assert (spec.backend, spec.env) == ("envpool", None)
    assert isinstance(spec.host_envs(2), PoolEnvs)
    assert type(spec.make_host().unwrapped).__name__ == "LunarLander"  # for the evaluation
    assert resolve(name, backend="envpool").backend == "envpool"
    host = resolve(name, backend="host")
    assert host.backend == "host"
    assert isinstance(host.host_envs(1), HostEnvs)
    np.testing.assert_array_equal(spec.features.high, host.features.high)  # envpool's own are 3.4e38
    assert np.all(spec.features.high <= 10)
    monkeypatch.setattr(pool, "is_installed", lambda: False)
    assert resolve(name).backend == "host"


def test_without_envpool_the_message_says_how_to_install_it(monkeypatch):
    envs = PoolEnvs("LunarLander-v3", 2)
    monkeypatch.setattr(pool, "is_installed", lambda: False)
    command = r"pip install 'sympol\[envpool\]'"
    with pytest.raises(MissingExtra, match=command):
        resolve("LunarLander-v3", backend="envpool")
    with pytest.raises(MissingExtra, match=command):
        envs.reset(0)


def test_only_what_has_been_compared_is_offered(monkeypatch):
    monkeypatch.setattr("sympol.envs.registry._ENTRIES", {})
    assert resolve("CartPole-v1").backend == "host"
    for name in ("CartPole-v1", "Blackjack-v1"):
        with pytest.raises(
            ValueError, match=f"{name} cannot be trained on through envpool, which has LunarL"
        ):
            resolve(name, backend="envpool")


def test_only_the_environment_as_it_is(monkeypatch):
    kwargs = {"enable_wind": True}
    assert resolve("LunarLander-v3", env_kwargs=kwargs).backend == "host"
    with pytest.raises(ValueError, match="by id and without env_kwargs"):
        resolve("LunarLander-v3", env_kwargs=kwargs, backend="envpool")
    assert resolve(lambda: resolve("LunarLander-v3").make_host()).backend == "host"
    monkeypatch.setattr("sympol.envs.registry._ENTRIES", {})
    register("LunarLander-v3", feature_names=list("abcdefgh"))
    assert resolve("LunarLander-v3").backend == "envpool"
    register("LunarLander-v3", resolve("LunarLander-v3").make_host)
    assert resolve("LunarLander-v3").backend == "host"


def test_it_is_not_imported_before_it_is_used():
    code = (
        "import sys; from sympol.envs.registry import resolve; resolve('LunarLander-v3').host_envs(2)\n"
        "assert 'envpool' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
