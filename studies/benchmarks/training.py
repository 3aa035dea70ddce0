"""How long a training takes, from process start to saved and tested tree, and where the time goes.

    python -m studies.benchmarks.training [--rivals]

Runs `sympol train CartPole-v1` for a million steps as a user would, in processes of its own: cold (nothing in the
compilation cache) and cached; with our preset and with the paper's. Then, inside one process, the seconds until the
deterministic tree first averages 475 over 100 validation episodes, and how a step's time splits. With --rivals
stable-baselines3 and rejax train beside it, each in an environment of its own (`studies.benchmarks.rivals`). Writes
studies/results/training.json.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from sympol.algorithms.config import Config
from sympol.algorithms.presets import preset
from sympol.algorithms.trainer import Trainer, make_loop
from sympol.algorithms.work import stops
from sympol.envs.registry import resolve

from .rivals.environment import train
from .timing import arguments_of, interleaved, write

ENV = "CartPole-v1"
SOLVED = 475.0


def run(cache: str, *arguments: str) -> dict[str, Any]:
    """One `sympol train` as a user runs it; its summary, and the seconds from process start to its end."""
    with tempfile.TemporaryDirectory() as folder:
        command = [
            sys.executable,
            "-m",
            "sympol.cli.app",
            "train",
            ENV,
            "--json",
            "--run-dir",
            f"{folder}/run",
        ]
        began = time.perf_counter()
        done = subprocess.run(
            [*command, *arguments],
            env={**os.environ, "SYMPOL_CACHE_DIR": cache},
            capture_output=True,
            text=True,
            check=True,
        )
        seconds = time.perf_counter() - began
    summary = json.loads(done.stdout)
    keys = ("return_mean", "nodes", "timesteps", "compile_seconds", "training_seconds", "steps_per_second")
    return {"process_seconds": round(seconds, 2), **{key: summary[key] for key in keys}}


def whole_runs(repeats: int) -> dict[str, Any]:
    """Cold and cached, our preset; the paper's, cold."""
    cold, cached = [], []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(run(cache))
            cached.append(run(cache))
    with tempfile.TemporaryDirectory() as cache:
        paper = run(cache, "--preset", "paper")
    return {"cold": cold, "cached": cached, "paper_preset_cold": paper}


def seconds_until_solved(seeds: range) -> list[float | None]:
    """Training seconds, validations included, until 100 validation episodes first average 475 or more."""
    config = Config.from_dict({**preset(ENV), "num_eval_episodes": 100})
    env = resolve(ENV).env
    assert env is not None
    times: list[float | None] = []
    for seed in seeds:
        trainer, state = Trainer(env, config, seed), None
        trainer.compile()
        began = time.perf_counter()
        for stop in stops(config):
            if state is not None and int(state.timestep) >= stop:
                continue
            state = trainer.advance(state, stop)
            if float(state.validation.last_return) >= SOLVED:
                times.append(round(time.perf_counter() - began, 2))
                break
        else:
            times.append(None)
    return times


def split() -> dict[str, float]:
    """Nanoseconds an environment step of each part, at the longest rollout, each compiled alone."""
    config = Config.from_dict(preset(ENV))
    env = resolve(ENV).env
    assert env is not None
    loop, trainer = make_loop(env, config), Trainer(env, config, 0)
    state = trainer.advance(None, stops(config)[0])
    hyper, key = config.hyperparameters(), jax.random.key(0)
    steps = config.chunk_size << config.max_stage

    @jax.jit
    def collecting(state: Any) -> Any:
        return loop.rollouts.collect(state, loop.rollouts.buffer(), np.int32(config.max_stage), key)

    after, experience = jax.block_until_ready(collecting(state))

    @jax.jit
    def learning(state: Any, experience: Any) -> Any:
        return loop.learn(hyper, state, experience, key)

    @jax.jit
    def validating(state: Any) -> Any:
        return loop.rollouts.evaluate(state, np.uint32(0))

    calls: dict[str, Callable[[], Any]] = {
        "collect": lambda: collecting(state),
        "update": lambda: learning(after, experience),
        "one validation": lambda: validating(state),
    }
    timings = interleaved(calls, repeats=5)
    per_step = {f"{name}_ns_per_step": timing.least / steps * 1e9 for name, timing in timings.items()}
    del per_step["one validation_ns_per_step"]
    return {**per_step, "validation_seconds": timings["one validation"].least * config.num_evals}


def rivals(repeats: int) -> dict[str, Any]:
    """Train stable-baselines3 (100,000 steps: it is slow) and rejax (a million)."""
    lengths = {"sb3": 100_000, "rejax": 1_000_000}
    return {name: [train(name, steps) for _ in range(repeats)] for name, steps in lengths.items()}


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("--rivals", action="store_true", help="train stable-baselines3 and rejax as well")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    results: dict[str, Any] = {"whole_runs": whole_runs(given.repeats)}
    if given.rivals:
        results["rivals"] = rivals(1)
    results["split"] = split()
    results["seconds_until_475"] = seconds_until_solved(range(5))
    print(json.dumps(results, indent=1))
    print(write("training", results))


if __name__ == "__main__":
    main()
