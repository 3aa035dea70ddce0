"""The verifier beside z3: python -m studies.benchmarks.verify

First, ten thousand random questions about random small trees (rules, monotonicity, equality; with and without one-hot
groups, whole numbers among the features), each put to both: do they agree? Then the time that one question takes about
a tree of 255 nodes over 8 features, asked in turns of both.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np
from rich.console import Console
from studies.benchmarks.timing import arguments_of, interleaved, write
from tests.trees.samples import ACTIONS, random_grouped_tree, random_tree
from tests.trees.verify.oracle import Answer, ask, ask_equal, ask_monotone, ask_rule

from sympol.trees import DecisionTree
from sympol.trees.verify import equal, margin, unreachable_leaves

DEPTH, FEATURES = 7, 8
QUESTIONS = {"rule": ask_rule, "monotone": ask_monotone, "equal": ask_equal}


def agreement(pairs: int) -> dict[str, Any]:
    """Random questions, half of them about trees with one-hot groups."""
    rng = np.random.default_rng(0)
    answers = [ask(rng, grouped=i % 2 == 1) for i in range(pairs)]
    different = [answer for answer in answers if answer.ours != answer.z3]
    for answer in different:
        print("they disagree:", answer)
    return {
        "pairs": pairs,
        "with_groups": pairs // 2,
        "disagreements": len(different),
        "kinds": dict(Counter(answer.kind for answer in answers)),
        "held": sum(answer.z3[0] for answer in answers),
        "held_vacuously": sum(answer.z3[1] for answer in answers),
        "our_seconds": sum(answer.our_seconds for answer in answers),
        "z3_seconds": sum(answer.z3_seconds for answer in answers),
    }


def large_tree(seed: int, kind: str = "discrete", *, grouped: bool = False) -> DecisionTree:
    """Draw a tree of 255 nodes."""
    rng = np.random.default_rng(seed)
    if grouped:
        return random_grouped_tree(rng, ACTIONS[kind], depth=DEPTH, sizes=(3, 3), n_free=2)
    return random_tree(rng, ACTIONS[kind], depth=DEPTH, n_features=FEATURES)


def beside_z3(questions: int) -> dict[str, Any]:
    """Median milliseconds of both for random questions about large trees."""
    found = {}
    for name, question in QUESTIONS.items():
        rng = np.random.default_rng(1)
        answers: list[Answer] = [question(rng, large_tree(i)) for i in range(questions)]
        found[name] = {
            "questions": questions,
            "disagreements": sum(answer.ours != answer.z3 for answer in answers),
            "our_milliseconds": 1e3 * median(answer.our_seconds for answer in answers),
            "z3_milliseconds": 1e3 * median(answer.z3_seconds for answer in answers),
        }
    return found


def times() -> dict[str, float]:
    """Milliseconds a question about one large tree, the least of many repeats."""
    tree, groups, box = large_tree(0), large_tree(0, grouped=True), large_tree(0, "box")
    pruned = tree.prune()
    rng = np.random.default_rng(2)
    seen = rng.normal(size=(1_000, FEATURES))
    questions: dict[str, Callable[[], object]] = {
        "when two comparisons then an action": lambda: tree.verify(
            "when x[0] > 0.1 and x[1] < 0.5 then action is left"
        ),
        "never an action": lambda: tree.verify("action is never left"),
        "when a category then an action": lambda: groups.verify("when g0 is c1 then action is left"),
        "bounds of a continuous action": lambda: box.verify("when x[0] > 0.1 then gas between -0.5 and 0.5"),
        "monotone": lambda: box.verify("gas is increasing in x[0]"),
        "equal to the pruned tree": lambda: equal(tree, pruned),
        "unreachable leaves": lambda: unreachable_leaves(tree),
        "margins of 1,000 observations": lambda: margin(tree, seen),
    }
    return {name: 1e3 * timing.least for name, timing in interleaved(_silent(questions)).items()}


def _silent(questions: dict[str, Callable[[], object]]) -> dict[str, Callable[[], None]]:
    def silent(question: Callable[[], object]) -> Callable[[], None]:
        def ask_once() -> None:
            question()

        return ask_once

    return {name: silent(question) for name, question in questions.items()}


def main() -> None:
    parser = arguments_of(__doc__)
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--questions", type=int, default=20)
    given = parser.parse_args()
    results = {
        "agreement": agreement(given.pairs),
        "tree": {"nodes": 2 ** (DEPTH + 1) - 1, "features": FEATURES},
        "milliseconds": times(),
        "beside_z3": beside_z3(given.questions),
    }
    console = Console()
    console.print(results)
    console.print(f"written to {write('verify', results)}", markup=False)


if __name__ == "__main__":
    main()
