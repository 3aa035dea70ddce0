"""CartPole by stable-baselines3's own PPO, its actor a tree: examples/sb3_tree.py on three seeds.

    python -m studies.benchmarks.sb3_tree PYTHON [STEPS]

PYTHON is an interpreter that has sympol and stable-baselines3. Writes studies/results/sb3_tree.json.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time

from .timing import ROOT, write_environments

SEEDS = range(3)
STEPS = 160_000


def train(python: str, steps: int, seed: int) -> dict[str, float]:
    """Run the example; what its last line says, and how long it took."""
    start = time.perf_counter()
    command = [python, str(ROOT / "examples" / "sb3_tree.py"), str(steps), str(seed)]
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    said = subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout.splitlines()[
        -1
    ]
    nodes, mean, std = re.findall(r"[\d.]+", said)[:3]
    seconds = time.perf_counter() - start
    return {
        "nodes": int(nodes),
        "return_mean": float(mean),
        "return_std": float(std),
        "seconds": round(seconds, 1),
    }


def main() -> None:
    python, *rest = sys.argv[1:]
    steps = int(rest[0]) if rest else STEPS
    results = [{"seed": seed, **train(python, steps, seed)} for seed in SEEDS]
    settings = {"steps": steps, "episodes": 100}
    print(write_environments("sb3_tree", settings, {"CartPole-v1": {"trainings": results}}))


if __name__ == "__main__":
    main()
