"""A training within a limit of size, beside the same training without one, pruned by its return afterwards.

    python -m studies.benchmarks.small_trees [ENV ...]

One million steps, our default presets, seeds 1000 to 1002. Each tree plays a thousand validation episodes inside the
compiled program, by which nothing was chosen. Writes studies/results/small_trees.json.
"""

from __future__ import annotations

import time
from typing import Any

from rich.console import Console
from rich.table import Table

import sympol
from sympol.search.evaluators import Evaluator, make_evaluator
from sympol.search.prune_by_return import prune_by_return
from sympol.search.round_thresholds import digits_of, round_thresholds
from sympol.trees import DecisionTree

from .timing import arguments_of, write_environments

LIMITS = {
    "CartPole-v1": (5, 7, 15),
    "MountainCarContinuous-v0": (9,),
    "Pendulum-v1": (15,),
    "Acrobot-v1": (9,),
    "LunarLander-v3": (53,),
}
SEEDS = (1000, 1001, 1002)
EPISODES = 1000


def row_of(tree: DecisionTree, judge: Evaluator, began: float) -> dict[str, Any]:
    """What a tree earns and how large it is."""
    digits = [digits_of(x) for x in tree.threshold[~tree.is_leaf].tolist()]
    return {
        "nodes": tree.n_nodes,
        "return_mean": round(float(judge.play([tree], range(EPISODES)).returns.mean(dtype=float)), 3),
        "digits_of_thresholds": sum(digits),
        "seconds": round(time.perf_counter() - began, 1),
    }


def measure(env: str, seed: int) -> dict[str, Any]:
    """One training without a limit, pruned to each size, and one training for each size."""
    began = time.perf_counter()
    free = sympol.PPO("tree", env, seed=seed).learn(progress_bar=False)
    judge, arena = make_evaluator(free.spec, seed, "validation"), make_evaluator(free.spec, seed)
    row: dict[str, Any] = {"seed": seed, "free": row_of(free.tree(), judge, began), "limits": {}}
    for limit in LIMITS[env]:
        began = time.perf_counter()
        afterwards = prune_by_return(free.tree(), arena, max_nodes=limit).tree
        pruned = row_of(afterwards, judge, began)
        began = time.perf_counter()
        trained = sympol.PPO("tree", env, seed=seed, max_nodes=limit).learn(progress_bar=False).tree()
        within = row_of(trained, judge, began)
        began = time.perf_counter()
        rounded = row_of(round_thresholds(trained, arena), judge, began)
        row["limits"][limit] = {"pruned_afterwards": pruned, "within": within, "rounded": rounded}
        print(env, seed, limit, row["limits"][limit], flush=True)
    return row


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("envs", nargs="*", metavar="ENV", default=list(LIMITS))
    given = parser.parse_args()
    results: dict[str, Any] = {}
    table = Table(
        "environment", "limit", "without a limit", "pruned afterwards", "within the limit", "rounded"
    )
    for env in given.envs:
        rows = [measure(env, seed) for seed in SEEDS]
        results[env] = {"trainings": rows}
        free = [row["free"] for row in rows]
        for limit in LIMITS[env]:
            of = [row["limits"][limit] for row in rows]
            columns = (
                free,
                *([each[name] for each in of] for name in ("pruned_afterwards", "within", "rounded")),
            )
            table.add_row(env, str(limit), *(_words(column) for column in columns))
    Console().print(table)
    print(write_environments("small_trees", {"episodes": EPISODES, "preset": "default"}, results))


def _words(column: list[dict[str, Any]]) -> str:
    return " ".join(f"{row['return_mean']:.1f}@{row['nodes']}" for row in column)


if __name__ == "__main__":
    main()
