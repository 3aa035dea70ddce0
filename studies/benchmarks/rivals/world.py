"""A world of another library, trained, evaluated and reported as its users do it, and beside it rejax if it has it.

A script of its own, run by the interpreter with the library (`studies.benchmarks.rivals.environment`):

    python world.py ID STEPS

It prints one line of JSON.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any


def command(*arguments: object) -> str:
    """Run a command of sympol and return what it prints."""
    words = [sys.executable, "-m", "sympol", *map(str, arguments)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"sympol {' '.join(map(str, arguments))}: {done.stderr[-1000:]}")
    return done.stdout


def ours(env_id: str, steps: int, folder: Path) -> dict[str, Any]:
    """Train a tree, evaluate it, write its page."""
    run = folder / "run"
    train = command(
        "train", env_id, "--total-timesteps", steps, "--eval-episodes", 10, "--run-dir", run, "--json"
    )
    summary = json.loads(train.splitlines()[-1])
    began = time.perf_counter()
    again = json.loads(command("eval", run, "--episodes", 10, "--json").splitlines()[-1])
    command("report", run, "--out", folder / "page.html")
    return {
        "steps": summary["timesteps"],
        "steps_per_second": summary["steps_per_second"],
        "compile_seconds": summary["compile_seconds"],
        "return_mean": again["return_mean"],
        "nodes": summary["nodes"],
        "eval_and_report_seconds": round(time.perf_counter() - began, 1),
        "page_bytes": (folder / "page.html").stat().st_size,
    }


def rejax(env_id: str, steps: int) -> dict[str, Any]:
    """rejax's PPO with an MLP on the same environment."""
    import jax
    from rejax import PPO  # pyright: ignore[reportMissingImports]

    library, _, name = env_id.partition(":")
    agent = PPO.create(
        env=name if library == "gymnax" else env_id,
        num_envs=32,
        num_steps=128,
        num_epochs=4,
        num_minibatches=16,
        learning_rate=0.0003,
        total_timesteps=steps,
        eval_freq=steps,
    )
    key = jax.random.PRNGKey(0)
    began = time.perf_counter()
    train = jax.jit(agent.train).lower(key).compile()
    compiled = time.perf_counter()
    _, (_, returns) = jax.block_until_ready(train(key))
    return {
        "steps": steps,
        "steps_per_second": round(steps / (time.perf_counter() - compiled)),
        "compile_seconds": round(compiled - began, 3),
        "return_mean": float(returns[-1].mean()),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks.rivals.world", description=__doc__)
    parser.add_argument("env_id")
    parser.add_argument("steps", type=int)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = {"sympol": ours(given.env_id, given.steps, Path(folder))}
    if importlib.util.find_spec("rejax") is not None:
        result["rejax"] = rejax(given.env_id, given.steps)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
