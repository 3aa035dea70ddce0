"""CartPole by stable-baselines3's own PPO, its actor a tree: examples/sb3_tree.py on three seeds.

    python -m studies.benchmarks.sb3_tree [STEPS]

It runs in an environment with stable-baselines3 (`studies.benchmarks.rivals`), which is built on first use. Writes
studies/results/sb3_tree.json.
"""

from __future__ import annotations

import re
import time

from .rivals.environment import interpreter, last_line
from .timing import ROOT, arguments_of, write_environments

SEEDS = range(3)
STEPS = 160_000


def train(steps: int, seed: int) -> dict[str, float]:
    """Run the example; return what its last line says, and the seconds that it took."""
    start = time.perf_counter()
    example = ROOT / "examples" / "sb3_tree.py"
    printed = last_line("sb3", example, steps, seed, OMP_NUM_THREADS="1")
    seconds = time.perf_counter() - start
    nodes, mean, std = re.findall(r"-?[\d.]+", printed)[:3]
    return {
        "nodes": int(nodes),
        "return_mean": float(mean),
        "return_std": float(std),
        "seconds": round(seconds, 1),
    }


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("steps", nargs="?", type=int, default=STEPS, metavar="STEPS")
    steps = parser.parse_args().steps
    interpreter("sb3")  # building it is no part of the seconds
    results = [{"seed": seed, **train(steps, seed)} for seed in SEEDS]
    print(*results, sep="\n")
    settings = {"steps": steps, "episodes": 100}
    print(write_environments("sb3_tree", settings, {"CartPole-v1": {"trainings": results}}))


if __name__ == "__main__":
    main()
