"""A training so small that only its compilation takes time; every test that can shares this one program."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import jax
import numpy as np
import pytest

import sympol
from sympol.cli.app import main

COLUMNS = (
    "time/total_timesteps",
    "time/time_elapsed",
    "time/fps",
    "rollout/ep_rew_mean",
    "rollout/ep_len_mean",
    "eval/mean_reward",
    "train/approx_kl",
    "train/clip_fraction",
    "train/entropy",
    "train/policy_gradient_loss",
    "train/value_loss",
)
"""The metrics of PPO."""

TINY: dict[str, Any] = {
    "total_timesteps": 2048,
    "depth": 3,
    "num_envs": 4,
    "num_steps": 16,
    "minibatch_size": 64,
    "num_epochs": 1,
    "critic_hidden": (8,),
    "num_evals": 8,
    "num_eval_episodes": 4,
}
ROLLOUT = 64
"""Samples of the first rollout."""

NAMES = ("a", "b", "c", "d")


def flags(config: dict[str, Any] | None = None) -> list[str]:
    """The config as flags of the command line."""
    words: list[str] = []
    for name, value in (TINY if config is None else config).items():
        flag = name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{flag}" if value else f"--no-{flag}")
        else:
            parts = value if isinstance(value, tuple) else (value,)
            words += [f"--{flag}", *map(str, parts)]
    return words


TRAIN = ["CartPole-v1", "--eval-episodes", "3", *flags()]


def agent(env: Any = "CartPole-v1", **options: Any) -> sympol.PPO:
    return sympol.PPO("tree", env, **{**TINY, **options})


def trained(env: Any = "CartPole-v1", **options: Any) -> sympol.PPO:
    return agent(env, **options).learn(progress_bar=False)


def status_of(*arguments: str | Path) -> int:
    """Run one command in this process."""
    try:
        return main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str | Path, status: int = 2) -> str:
    """Run a command that must fail with one line; return the line."""
    assert status_of(*arguments) == status
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1, said.err
    assert said.err.startswith("error: ")
    return said.err


def start(*arguments: str | Path, folder: Path, **variables: str) -> subprocess.Popen[str]:
    """Start a command in a process of its own, with the same programs at hand; ``variables`` are its environment's."""
    environment = {
        **os.environ,
        "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1",
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), str(Path(sympol.__file__).parents[1])]),
        "SYMPOL_CACHE_DIR": "",
        **variables,
    }
    command = [sys.executable, "-m", "sympol", *map(str, arguments)]
    pipes: dict[str, Any] = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "stdin": subprocess.DEVNULL,
    }
    return subprocess.Popen(command, cwd=folder, env=environment, text=True, **pipes)


@pytest.fixture(scope="module", autouse=True)
def quick_compiles() -> Iterator[None]:
    """Half the compile time, for a program that runs for a moment. Import it where it is wanted."""
    before = jax.config.values["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


class Chain(gymnasium.Env):
    """Any two spaces: samples of the one, rewards for the other's own samples, 10 steps an episode."""

    def __init__(
        self,
        observation_space: gymnasium.Space,
        action_space: gymnasium.Space,
        trouble: Callable | None = None,
    ) -> None:
        self.observation_space, self.action_space, self.trouble = observation_space, action_space, trouble
        self.seeds: list[int | None] = []
        self.steps = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.seeds.append(seed)
        if seed is not None:
            self.observation_space.seed(seed)
        self.time = 0
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action), (action, type(action))
        self.time, self.steps = self.time + 1, self.steps + 1
        reward = float(np.sum(action))
        observation = self.observation_space.sample()
        if self.trouble is not None:
            observation, reward = self.trouble(self.steps, observation, reward)
        return observation, reward, False, self.time >= 10, {}


def read_summary(run: Path) -> dict[str, Any]:
    return json.loads((run / "summary.json").read_text())


def csv_without_time(run: Path) -> list[list[str]]:
    """metrics.csv but for time_elapsed and fps."""
    rows = [line.split(",") for line in (run / "metrics.csv").read_text().splitlines()]
    return [[row[0], *row[3:]] for row in rows]
