"""How much a race is spared where what trees do alike is played once.

    python -m studies.benchmarks.races [--episodes N] [--trees N] [--repeats N]

The best kept trees of LunarLander with at most 63 nodes, one of each search (studies/results/fronts), raced by their
random questions (`sympol.search.insert_splits`) and by their cuts (`sympol.search.prunings`): each tree alone
(`Evaluator.play`) and all as
changes of one (`Evaluator.play_variants`), which brings the same returns. Writes studies/results/races.json.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from studies.galleries.fronts import load

from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.search.evaluators import make_evaluator
from sympol.search.insert_splits import apply_insertions, sample_insertions
from sympol.search.prunings import apply_prunings, prune_moves
from sympol.trees import DecisionTree

from .timing import ROOT, arguments_of, interleaved, write

ENVIRONMENT, MAX_NODES = "LunarLander-v3", 63
WATCHED = 64
"""Episodes that changes are drawn from."""


def changed(tree: DecisionTree, spec: EnvSpec, number: int) -> dict[str, list[DecisionTree]]:
    """What races are of."""
    seen = make_evaluator(spec, 0).observe(tree, range(WATCHED))
    some = sample_insertions(tree, seen, number, np.random.default_rng(0))
    return {
        "questions": [apply_insertions(tree, [sprout]) for sprout in some],
        "prune_moves": [apply_prunings(tree, [cut]) for cut in prune_moves(tree, seen)[:number]],
    }


def measured(
    tree: DecisionTree, others: list[DecisionTree], spec: EnvSpec, episodes: range, repeats: int
) -> dict[str, Any]:
    """One race: steps and seconds alone, and as changes of one tree."""
    alone, together = make_evaluator(spec, 1), make_evaluator(spec, 1)
    one = alone.play([tree, *others], episodes).returns
    np.testing.assert_array_equal(together.play_variants(tree, others, episodes).returns, one)
    steps = {"alone": alone.steps, "together": together.steps}
    times = interleaved(
        {
            "alone": lambda: alone.play([tree, *others], episodes),
            "together": lambda: together.play_variants(tree, others, episodes),
        },
        repeats,
    )
    return {"steps": steps, "seconds": {name: timing.least for name, timing in times.items()}}


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("--episodes", type=int, default=32, help="of a race")
    parser.add_argument("--trees", type=int, default=64, help="that race")
    parser.add_argument("--repeats", type=int, default=3, help="of each, in turns")
    given = parser.parse_args()
    spec, races = resolve(ENVIRONMENT), []
    table = Table("search", "race", "steps", "as changes", "seconds", "as changes")
    for front in load(ROOT / "studies" / "results" / "fronts" / f"{ENVIRONMENT}.json"):
        point = front.best(max_nodes=MAX_NODES)
        assert point is not None
        for kind, others in changed(point.tree, spec, given.trees).items():
            row = measured(point.tree, others, spec, range(given.episodes), given.repeats)
            races.append({"seed": front.seed, "of": kind, "nodes": point.tree.n_nodes, **row})
            steps, seconds = row["steps"], row["seconds"]
            table.add_row(
                str(front.seed),
                kind,
                f"{steps['alone']:,}",
                f"{steps['together']:,}",
                f"{seconds['alone']:.2f}",
                f"{seconds['together']:.2f}",
            )
    Console().print(table)
    settings = {name: getattr(given, name) for name in ("episodes", "trees", "repeats")}
    print(write("races", {"settings": settings, "races": races}))


if __name__ == "__main__":
    main()
