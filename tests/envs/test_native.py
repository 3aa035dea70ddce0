"""Copies stepped by machine code, behind the interface of `HostEnvs`: every row is experience, seeded, in its place."""

from __future__ import annotations

import subprocess
import sys
from unittest.mock import patch

import numpy as np
import pytest

from sympol.envs.adapters import ADAPTERS
from sympol.envs.entries import REGISTERED
from sympol.envs.errors import MissingExtra
from sympol.envs.host_envs import HostEnvs
from sympol.envs.lunar_lander import engine
from sympol.envs.lunar_lander.engine import IDS as TASKS
from sympol.envs.lunar_lander.engine import NativeEnvs
from sympol.envs.registry import register, resolve

NUM_ENVS = 6
CONTINUOUS = "LunarLanderContinuous-v3"


def random_actions(task: str, num_steps: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    if task == CONTINUOUS:
        return rng.uniform(-1, 1, (num_steps, NUM_ENVS, 2)).astype(np.float32)
    return rng.integers(0, 4, (num_steps, NUM_ENVS)).astype(np.int32)


def roll(task: str, seed: int, num_steps: int = 300) -> tuple[np.ndarray, ...]:
    """Observations, rewards, terminated, truncated, last observations, each ``[num_steps, envs, …]``."""
    envs, rows = NativeEnvs(NUM_ENVS), []
    observation = envs.reset(seed)
    for action in random_actions(task, num_steps):
        step, following = envs.step(action)
        rows.append((observation, step.reward, step.terminated, step.truncated, step.observation))
        observation = following
    envs.close()
    return tuple(np.stack(column) for column in zip(*rows, strict=True))


@pytest.mark.parametrize("task", TASKS)
def test_the_seed_decides(task):
    first, again, other = roll(task, 7), roll(task, 7), roll(task, 8)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(first, again, strict=True))
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


@pytest.mark.parametrize("task", TASKS)
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
    envs = NativeEnvs(NUM_ENVS)
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
    some, every = NativeEnvs(NUM_ENVS), NativeEnvs(NUM_ENVS)
    np.testing.assert_array_equal(some.reset(3), every.reset(3))
    for action in random_actions(task, 200):
        (step, after), (whole, whole_after) = some.step(action, wanted), every.step(action)
        for part, full in zip((*step, after), (*whole, whole_after), strict=True):
            np.testing.assert_array_equal(np.asarray(part)[wanted], np.asarray(full)[wanted])
        assert not np.any(np.asarray(step.terminated)[~wanted])


@pytest.mark.parametrize("name", TASKS)
def test_it_is_taken_where_it_is_installed(name, monkeypatch):
    spec = resolve(name)
    assert (spec.backend, spec.env) == ("native", None)
    assert isinstance(spec.host_envs(2), NativeEnvs)
    assert type(spec.make_host().unwrapped).__name__ == "LunarLander"  # for the evaluation
    assert resolve(name, backend="native").backend == "native"
    host = resolve(name, backend="host")
    assert host.backend == "host"
    assert isinstance(host.host_envs(1), HostEnvs)
    np.testing.assert_array_equal(spec.features.high, host.features.high)
    assert np.all(spec.features.high <= 10)
    monkeypatch.setattr(engine, "is_installed", lambda: False)
    assert resolve(name).backend == "host"


def test_without_numba_the_message_says_how_to_install_it(monkeypatch):
    envs = NativeEnvs(2)
    monkeypatch.setattr(engine, "is_installed", lambda: False)
    command = r"pip install 'sympol\[box2d\]'"
    with pytest.raises(MissingExtra, match=command):
        resolve("LunarLander-v3", backend="native")
    with pytest.raises(MissingExtra, match=command):
        envs.reset(0)


def test_only_what_has_been_compared_is_offered(monkeypatch):
    monkeypatch.delitem(ADAPTERS, "CartPole-")
    assert resolve("CartPole-v1").backend == "host"
    for name in ("CartPole-v1", "Blackjack-v1"):
        with pytest.raises(
            ValueError, match=f"{name} cannot be stepped by our own machine code, which has L"
        ):
            resolve(name, backend="native")


@patch.dict(REGISTERED)
def test_only_the_environment_as_it_is():
    kwargs = {"enable_wind": True}
    assert resolve("LunarLander-v3", env_kwargs=kwargs).backend == "host"
    with pytest.raises(ValueError, match="by id and without env_kwargs"):
        resolve("LunarLander-v3", env_kwargs=kwargs, backend="native")
    assert resolve(lambda: resolve("LunarLander-v3").make_host()).backend == "host"
    register("LunarLander-v3", feature_names=list("abcdefgh"))
    assert resolve("LunarLander-v3").backend == "native"
    register("LunarLander-v3", resolve("LunarLander-v3").make_host)
    assert resolve("LunarLander-v3").backend == "host"


def test_it_is_not_imported_before_it_is_used():
    code = (
        "import sys; from sympol.envs.registry import resolve; resolve('LunarLander-v3').host_envs(2)\n"
        "assert 'numba' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
