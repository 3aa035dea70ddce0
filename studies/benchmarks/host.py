"""Environments of Gymnasium: the cost of stepping them beside Gymnasium's own loop, and steps/s beside SB3.

    python -m studies.benchmarks.host [--repeats 5] [--seconds 10]

The first table is the time that a step of one copy takes beyond the environment's own: one that does nothing,
in `gymnasium.vector.SyncVectorEnv` and in ours, in turns. The second is the throughput of PPO, collecting and
learning, with the same eight copies, rollouts, epochs and minibatches: stable-baselines3 with its MLP in this process
(``DummyVecEnv``) and with a process for each copy (``SubprocVecEnv``), and our trees without and with
``env_workers=8``. Steps and resets take their time by waiting. Writes studies/results/host.json.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import jax
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from sympol.algorithms.config import Config
from sympol.algorithms.trainer import make_loop
from sympol.envs.registry import resolve

from .timing import arguments_of, interleaved, write

NUM_ENVS, NUM_STEPS, EPOCHS, MINIBATCH = 8, 64, 10, 64
CASES = {"0 ms": (0.0, 0.0), "2 ms": (0.002, 0.0), "20 ms": (0.02, 0.0), "reset 20 ms": (0.0, 0.02)}
"""Seconds of a step and of a reset."""


class Waits(gymnasium.Env):
    """An environment that does nothing but wait; an episode lasts 50 steps."""

    observation_space: gymnasium.Space = Box(-1, 1, (8,))
    action_space = Discrete(2)

    def __init__(self, step: float = 0.0, reset: float = 0.0) -> None:
        self.seconds, self.time = (step, reset), 0
        self.answer: Any = np.zeros(8, np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        self._wait(self.seconds[1])
        self.time = 0
        return self.answer, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self._wait(self.seconds[0])
        self.time += 1
        return self.answer, 1.0, False, self.time >= 50, {}

    @staticmethod
    def _wait(seconds: float) -> None:
        if seconds:
            time.sleep(seconds)


class Parts(Waits):
    """The same with an observation of parts."""

    observation_space = Dict({"a": Box(-1, 1, (4,)), "b": Discrete(3), "c": Box(0, 1, (2, 2))})

    def __init__(self) -> None:
        super().__init__()
        self.answer = {"a": np.zeros(4, np.float32), "b": 1, "c": np.zeros((2, 2), np.float32)}


def overhead(repeats: int) -> dict[str, dict[str, float]]:
    """Microseconds that a step of one copy takes, of both loops, and what ours takes more."""
    result = {}
    for name, make in (("Box", Waits), ("Dict", Parts)):
        for num_envs in (8, 32):
            actions = np.zeros(num_envs, np.int32)
            theirs: Any = SyncVectorEnv([make] * num_envs, autoreset_mode=AutoresetMode.SAME_STEP)
            ours = resolve(make).host_envs(num_envs)
            theirs.reset(seed=0)
            ours.reset(0)

            def steps(step: Callable[[Any], Any], actions: Any = actions) -> None:
                for _ in range(200):
                    step(actions)

            calls = {"SyncVectorEnv": partial(steps, theirs.step), "sympol": partial(steps, ours.step)}
            timings = interleaved(calls, repeats)
            row = {who: timing.least / 200 / num_envs * 1e6 for who, timing in timings.items()}
            result[f"{name}, {num_envs} copies"] = {**row, "more": row["sympol"] - row["SyncVectorEnv"]}
    return result


def ours(make: Callable[[], gymnasium.Env], env_workers: int, seconds: float) -> float:
    """Steps per second of our PPO."""
    config = Config(
        num_envs=NUM_ENVS,
        num_steps=NUM_STEPS,
        num_epochs=EPOCHS,
        minibatch_size=MINIBATCH,
        dynamic_rollout=False,
        dynamic_batch=False,
        total_timesteps=10_000_000,
    )
    loop = make_loop(resolve(make).stepped_by(env_workers), config.static())
    hyper, seed = config.hyperparameters(), np.uint32(0)
    state = jax.jit(loop.begin)(hyper, seed, loop.template())
    state = loop.rollouts.begin_segment(state, seed)
    state, _ = loop.iterate(hyper, state, None)
    state, _ = loop.iterate(hyper, state, None)
    first, began = int(state.timestep), time.perf_counter()
    while time.perf_counter() - began < seconds:
        state, _ = loop.iterate(hyper, state, None)
        jax.block_until_ready(state.networks)
    rate = (int(state.timestep) - first) / (time.perf_counter() - began)
    loop.rollouts.close()
    return rate


def theirs(make: Callable[[], gymnasium.Env], kind: str, seconds: float) -> float:
    """Steps per second of stable-baselines3's PPO."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    class Clock(BaseCallback):
        def __init__(self) -> None:
            super().__init__()
            self.began, self.first, self.rate = 0.0, 0, 0.0

        def _on_step(self) -> bool:
            return self.rate == 0.0

        def _on_rollout_start(self) -> None:
            now, rollout = time.perf_counter(), NUM_ENVS * NUM_STEPS
            if self.num_timesteps == 2 * rollout:
                self.began, self.first = now, self.num_timesteps
            elif self.num_timesteps > 2 * rollout and now - self.began > seconds:
                self.rate = (self.num_timesteps - self.first) / (now - self.began)

    torch.set_num_threads(1)
    if kind == "DummyVecEnv":
        envs: Any = DummyVecEnv([make] * NUM_ENVS)
    else:
        envs = SubprocVecEnv([make] * NUM_ENVS, start_method="spawn")
    model = stable_baselines3.PPO(
        "MlpPolicy", envs, n_steps=NUM_STEPS, batch_size=MINIBATCH, n_epochs=EPOCHS, device="cpu"
    )
    clock = Clock()
    model.learn(10_000_000, callback=clock)
    envs.close()
    return clock.rate


def throughput(seconds: float) -> dict[str, dict[str, float]]:
    """Steps per second of each, case by case."""
    result = {}
    for name, (step, reset) in CASES.items():
        make = partial(Waits, step, reset)
        result[name] = {
            "sb3 DummyVecEnv": theirs(make, "DummyVecEnv", seconds),
            "sb3 SubprocVecEnv": theirs(make, "SubprocVecEnv", seconds),
            "sympol": ours(make, 0, seconds),
            "sympol env_workers=8": ours(make, NUM_ENVS, seconds),
        }
        print(name, {who: round(rate) for who, rate in result[name].items()}, flush=True)
    return result


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("--repeats", type=int, default=20, help="of the loops, in turns")
    parser.add_argument("--seconds", type=float, default=10.0, help="of each training")
    given = parser.parse_args()
    costs = overhead(given.repeats)
    for name, row in costs.items():
        print(name, {who: round(microseconds, 2) for who, microseconds in row.items()}, flush=True)
    rates = throughput(given.seconds)
    print(f"written to {write('host', {'microseconds_per_step_and_copy': costs, 'steps_per_second': rates})}")


if __name__ == "__main__":
    main()
