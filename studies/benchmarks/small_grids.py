"""How near MiniGrid's small trees come to what each episode allows, from every start there is.

    python -m studies.benchmarks.small_grids

The trees are those that `sympol pareto` found and `studies/results/fronts` keeps: of each run the best of at most
as many nodes as its target has. Followed through the world's graph, from each start with its probability: the share
of the greatest return that a policy with memory and sight of everything could have, and whether it reaches the goal.
Beside it what a policy can reach at most that sees what the tree sees and remembers nothing
(`studies.benchmarks.memoryless`).
Writes studies/results/small_grids.json, and prints what docs/guides/pareto.md shows of it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from statistics import mean
from typing import Any

from studies.galleries.fronts import load_all
from studies.galleries.published import targets
from tests.envs.minigrid_worlds import all_starts

from sympol.envs.minigrid import TASKS, make
from sympol.search.front.front import Front

from .minigrid import returns_from_all_starts
from .timing import ROOT, arguments_of, write

COLUMNS = ("task", "at most", "share of the optimum", "every run", "without memory", "starts solved", "nodes")


def measured(fronts: Sequence[Front], at_most: int, bound: float | None) -> dict[str, Any]:
    """Of one task: the best tree of at most so many nodes of each run."""
    env = make(fronts[0].environment)
    _, probability = all_starts(env)
    runs: list[dict[str, Any]] = []
    for front in fronts:
        point = front.best(at_most)
        assert point is not None
        earned, best = returns_from_all_starts(point.tree, env)
        runs.append(
            {
                "seed": front.seed,
                "nodes": point.nodes,
                "share": float((earned / best) @ probability),
                "solved": int((earned > 0).sum()),
            }
        )
    return {"at_most": at_most, "starts": len(probability), "without_memory_at_most": bound, "runs": runs}


def markdown(tasks: Mapping[str, Mapping[str, Any]]) -> str:
    """A line for each task."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|"]
    for name, row in tasks.items():
        runs, bound = row["runs"], row["without_memory_at_most"]
        cells = (
            name.removeprefix("MiniGrid-").removeprefix("sympol/").removesuffix("-v0"),
            str(row["at_most"]),
            f"{mean(run['share'] for run in runs):.2%}",
            " ".join(f"{100 * run['share']:.2f}" for run in runs),
            "–" if bound is None else f"{bound:.2%}",
            " ".join(f"{run['solved']}" for run in runs) + f" of {row['starts']}",
            " ".join(str(run["nodes"]) for run in runs),
        )
        lines.append(f"| {' | '.join(cells)} |".replace("%", " %"))
    return "\n".join(lines) + "\n"


def main() -> None:
    """Follow, print, write."""
    arguments_of(__doc__).parse_args()
    bounds = json.loads((ROOT / "studies" / "results" / "memoryless.json").read_text(encoding="utf-8"))[
        "tasks"
    ]
    tasks = {
        fronts[0].environment: measured(
            fronts, target.nodes, bounds.get(fronts[0].environment, {}).get("share_bound")
        )
        for fronts in load_all(ROOT)
        if fronts[0].environment in TASKS
        for target in targets(fronts[0].environment)
    }
    print(markdown(tasks))
    print(write("small_grids", {"tasks": tasks}))


if __name__ == "__main__":
    main()
