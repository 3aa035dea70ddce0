"""Worker processes that step environments: the same results to the bit, no JAX, no process left behind."""

from __future__ import annotations

import dataclasses
import os
import threading
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

from sympol.algorithms.trainer import Trainer
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.host_envs import HostEnvs
from sympol.envs.registry import resolve

from ..algorithms.test_host_training import CONFIG, assert_same_bits
from .chance import Chance


def envs_of(make: Any, num_envs: int, workers: int = 0) -> HostEnvs:
    envs = resolve(make).stepped_by(workers).host_envs(num_envs)
    assert isinstance(envs, HostEnvs)
    return envs


def pids(envs: HostEnvs) -> list[int]:
    assert envs.workers is not None
    return [worker.pid for worker in envs.workers.workers]


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture(scope="module")
def pair() -> Iterator[tuple[HostEnvs, HostEnvs]]:
    here, there = envs_of(Chance, 5), envs_of(Chance, 5, workers=2)
    yield here, there
    here.close()
    there.close()
    assert not any(map(is_running, pids(there)))


def test_workers_change_nothing_to_the_bit(pair):
    here, there = pair
    assert here.reset(7)[:, :5].tobytes() == there.reset(7)[:, :5].tobytes()
    rng = np.random.default_rng(0)
    for i in range(100):
        actions = rng.uniform(-1, 1, (5, 2)).astype(np.float32)
        wanted = rng.uniform(size=5) < 0.5 if i % 3 == 0 else np.ones(5, bool)
        (step, after), (other, other_after) = here.step(actions, wanted, 20), there.step(actions, wanted, 20)
        for a, b in zip((*step[1:],), (*other[1:],), strict=True):
            assert np.asarray(a)[wanted].tobytes() == np.asarray(b)[wanted].tobytes()
        for a, b in ((step[0], other[0]), (after, other_after)):
            assert np.asarray(a)[wanted, :5].tobytes() == np.asarray(b)[wanted, :5].tobytes()
        np.testing.assert_array_equal(here.episode, there.episode)
    assert here.was_cut == there.was_cut


def test_a_worker_imports_no_jax(pair):
    observation = pair[1].reset(0)
    assert observation[:, 5].tolist() == [1] * 5  # "jax = 0"
    envs = resolve("CartPole-v1", backend="host").stepped_by(1).host_envs(1)
    assert isinstance(envs, HostEnvs)
    envs.reset(0)
    with open(f"/proc/{pids(envs)[0]}/maps") as maps:
        assert "jaxlib" not in maps.read()
    envs.close()


def test_a_training_with_workers_is_the_one_without():
    """Training copies and validation copies are in the same two processes, which end with the training."""
    config = dataclasses.replace(CONFIG, num_eval_episodes=3, num_epochs=1)
    states = []
    for workers in (0, 2):
        trainer = Trainer(resolve("FrozenLake-v1").stepped_by(workers), config, 0)
        states.append(trainer.advance(trainer.advance(None, 256), 512))
        trainer.close()
    assert_same_bits(*states)


def test_a_failure_names_the_environment():
    envs = envs_of(lambda: Chance("raise"), 2, workers=2)
    envs.reset(0)
    with pytest.raises(
        EnvironmentFailure, match=r"environment 0 failed in step\(.*ZeroDivisionError: by the env"
    ):
        envs.step(np.zeros((2, 2), np.float32))
    envs.close()


def test_a_worker_that_dies_is_named_and_none_is_left():
    envs = envs_of(lambda: Chance("die"), 4, workers=2)
    envs.reset(0)
    with pytest.raises(
        EnvironmentFailure, match=r"^worker 1 of 2, which steps environments 0 to 1, was ended by SIGKILL"
    ):
        envs.step(np.zeros((4, 2), np.float32))
    envs.close()
    assert not any(map(is_running, pids(envs)))


def test_what_cannot_be_sent_is_refused_in_one_line():
    held = threading.Lock()

    def make() -> gymnasium.Env:
        assert held is not None
        return Chance()

    with pytest.raises(ValueError, match=r"env_workers must be 0, or the function .* be sent") as error:
        envs_of(make, 2, workers=2)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"env_workers must be 0, got 2: .* give a function"):
        envs_of(Chance(), 2, workers=2)


@pytest.mark.parametrize("number", [-1, True, 1.5, "2", 10**6])
def test_a_number_of_workers_is_checked(number):
    with pytest.raises(ValueError, match="env_workers must be a whole number from 0 to 1024, got"):
        resolve(Chance).stepped_by(number)


def test_workers_are_for_gymnasium():
    for name, where in (
        ("CartPole-v1", "inside the compiled program"),
        ("LunarLander-v3", "in machine code"),
    ):
        with pytest.raises(ValueError, match=f"env_workers must be 0 for {name}, which is stepped {where}"):
            resolve(name).stepped_by(2)
