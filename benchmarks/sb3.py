"""Our MLP beside stable-baselines3's, PPO both, at the same budget: is the rival of our tables as good as it should be?

    python -m benchmarks.sb3 PYTHON [STEPS]

PYTHON is the interpreter of a virtual environment with stable-baselines3 (its pins would hold back ours). Two tasks,
three trainings each, 100 test episodes a training; ours with its default preset, theirs with the settings of
rl-baselines3-zoo. In turns, so that a busy machine meets both. Writes results/sb3.json.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from rich.console import Console
from rich.table import Table

import sympol
from sympol.play import play

from .timing import ROOT, write_environments

TASKS = ("Acrobot-v1", "Pendulum-v1")
SEEDS = range(3)
EPISODES = 100
STEPS = 200_000
TEST_SEED = 2026


def ours(env: str, seed: int, steps: int) -> dict[str, float]:
    """Train and test our MLP."""
    agent = sympol.PPO("mlp", env, seed=seed).learn(steps, progress_bar=False)
    returns = play(agent, agent.spec, EPISODES, seed=TEST_SEED + seed).returns
    return {"return_mean": float(returns.mean()), "steps": agent.num_timesteps}


def theirs(python: str, env: str, seed: int, steps: int) -> dict[str, Any]:
    """Train and test stable-baselines3's in a process of its own."""
    command = [python, str(ROOT / "benchmarks" / "rivals.py"), "sb3", str(steps), env, str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    """Measure, print, write."""
    python, steps = sys.argv[1], int(sys.argv[2]) if sys.argv[2:] else STEPS
    table = Table("environment", "sympol, MLP", "stable-baselines3", "steps")
    results = {}
    for env in TASKS:
        pairs = [(ours(env, seed, steps), theirs(python, env, seed, steps)) for seed in SEEDS]
        found = {
            "sympol": [pair[0]["return_mean"] for pair in pairs],
            "stable-baselines3": [pair[1]["return_mean"] for pair in pairs],
        }
        results[env] = {**found, "stable_baselines3_seconds": [pair[1]["training_seconds"] for pair in pairs]}
        table.add_row(env, *(" ".join(f"{r:.0f}" for r in returns) for returns in found.values()), str(steps))
    Console().print(table)
    print(write_environments("sb3", {"steps": steps, "episodes": EPISODES, "seeds": list(SEEDS)}, results))


if __name__ == "__main__":
    main()
