"""How near MiniGrid's small trees come to what each episode allows, from every start there is.

    python -m benchmarks.small_grids

The trees are those that `sympol pareto` found and `results/fronts` keeps: of each run the best of at most so many nodes
as were asked for. Followed through the world's graph, from each start with its probability: the share of the greatest
return that a policy with memory and sight of everything could have, and whether it comes to the goal at all. Beside it
what a policy can reach at most that sees what the tree sees and remembers nothing (`benchmarks.memoryless`). Writes
results/small_grids.json.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tests.envs.minigrid_worlds import all_starts

from sympol.envs.minigrid import TASKS, make
from sympol.pareto.gallery import load_all
from sympol.pareto.references import targets

from .minigrid import returns_from_all_starts
from .timing import ROOT, write


def main() -> None:
    """Follow, print, write."""
    bounds = json.loads((ROOT / "results" / "memoryless.json").read_text(encoding="utf-8"))["tasks"]
    columns = ("nodes", "share of the optimum", "every run", "without memory at most", "starts solved")
    table, results = Table("task", *columns), {}
    for fronts in load_all(ROOT):
        name = fronts[0].environment
        if name not in TASKS:
            continue
        env = make(name)
        _, probability = all_starts(env)
        for target in targets(name):
            runs: list[dict[str, Any]] = []
            for front in fronts:
                point = front.best(target.nodes)
                assert point is not None
                earned, best = returns_from_all_starts(point.tree, env)
                share = earned / best
                runs.append(
                    {
                        "seed": front.seed,
                        "nodes": point.nodes,
                        "share": float(share @ probability),
                        "least_share": float(share.min()),
                        "solved": int((share > 0).sum()),
                        "starts": len(share),
                    }
                )
            results[name] = {"at_most": target.nodes, "runs": runs}
            table.add_row(
                name,
                str(target.nodes),
                f"{np.mean([run['share'] for run in runs]):.2%}",
                " ".join(f"{run['share']:.2%} ({run['nodes']})" for run in runs),
                f"{bounds[name]['share_bound']:.2%}" if name in bounds else "–",
                " ".join(f"{run['solved']}/{run['starts']}" for run in runs),
            )
    Console(width=180).print(table)
    print(write("small_grids", {"tasks": results}))


if __name__ == "__main__":
    main()
