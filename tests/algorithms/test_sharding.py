"""One training on many devices: virtual ones of the CPU, in one process and in two."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.algorithms.config import Config, ConfigError
from sympol.algorithms.trainer import make_trainer
from sympol.envs.registry import resolve

from ..tiny import Chain

SCRIPT = Path(__file__).with_name("many_devices.py")


def start(devices_here: int, *arguments: object) -> subprocess.Popen[str]:
    environment = os.environ | {"XLA_FLAGS": f"--xla_force_host_platform_device_count={devices_here}"}
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def result(process: subprocess.Popen[str]) -> dict:
    out, err = process.communicate(timeout=240)
    assert process.returncode == 0, err[-2000:]
    return json.loads(out.splitlines()[-1])


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return result(start(1, 1, tmp_path_factory.mktemp("alone") / "run"))


def assert_same_training(one: dict, other: dict) -> None:
    for a, b in zip(one["networks"], other["networks"], strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4)


@pytest.mark.slow
def test_four_devices_train_what_one_does(alone, tmp_path):
    many = result(start(4, 4, tmp_path / "run"))
    assert many["spread"] == 4
    assert_same_training(alone, many)


@pytest.mark.slow
def test_two_processes_train_what_one_does(alone, tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    both = [start(1, 2, tmp_path / f"run-{i}", address, i) for i in range(2)]
    first, second = (result(process) for process in both)
    assert first["processes"] == second["processes"] == 2
    assert first["networks"] == second["networks"]
    assert_same_training(alone, first)
    runs = [sympol.load(tmp_path / f"run-{i}") for i in range(2)]
    assert runs[0].tree() == runs[1].tree()


def test_more_devices_than_there_are():
    config = Config(num_devices=16)
    with pytest.raises(ConfigError, match=r"at most the number of devices, .* got 16; .*device_count=16"):
        make_trainer(resolve("CartPole-v1"), config, 0)


def test_the_host_has_its_environments_in_one_place():
    spec = resolve(lambda: Chain(Box(-1, 1, (2,)), Discrete(2)))
    with pytest.raises(ConfigError, match=r"num_devices must be 1 for .*, which the host steps, got 2"):
        make_trainer(spec, Config(num_devices=2), 0)


def test_devices_step_as_many_environments_each():
    with pytest.raises(ConfigError, match=r"num_devices must divide num_envs, 32, .* got 3"):
        Config(num_devices=3)
