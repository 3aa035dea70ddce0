"""How fast trees are compared: steps a second of the arena beside what the environment alone does.

    python -m studies.benchmarks.arena [--trees N] [--episodes N] [--repeats N]

Many complete trees of 15 and of 63 nodes, drawn at random, each on the same episodes
(`sympol.search.evaluators.base`); of the
environments written in JAX in a compiled program, of MiniGrid's small worlds also from tables, of LunarLander in
machine code beside Gymnasium. One leaf means the same with trees that compare nothing, which is what the environment
alone does. In turns, the best of all repeats of each, by the clock and by the processor's time: on a shared machine the
second says more. Writes studies/results/arena.json.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.search.evaluators import Evaluator, make_evaluator
from sympol.search.evaluators.jax import JaxEvaluator
from sympol.search.evaluators.tabular import TabularEvaluator
from sympol.trees import DecisionTree

from .timing import arguments_of, write

ENVIRONMENTS = (
    "CartPole-v1",
    "Acrobot-v1",
    "Pendulum-v1",
    "MountainCarContinuous-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-LavaGapS7-v0",
    "sympol/DistShift-Random-v0",
    "LunarLander-v3",
)
DEPTHS = {"one leaf": 0, "15 nodes": 3, "63 nodes": 5}


class Rate(NamedTuple):
    """Steps a second."""

    clock: float
    processor: float


def random_trees(spec: EnvSpec, depth: int, num: int) -> list[DecisionTree]:
    """Complete trees that compare with numbers seen at the start of episodes."""
    rng, features = np.random.default_rng(depth), spec.features
    seen = make_evaluator(spec, 0).observe(
        complete(spec, 0, rng, np.zeros((1, len(features.names)))), range(16)
    )
    return [complete(spec, depth, rng, seen) for _ in range(num)]


def complete(spec: EnvSpec, depth: int, rng: np.random.Generator, seen: np.ndarray) -> DecisionTree:
    """One of them; a one-hot feature is compared with a half."""
    inner, grouped = (1 << depth) - 1, [i for group in spec.features.groups for i in group.features]
    feature = rng.integers(0, len(spec.features.names), inner)
    threshold = np.where(np.isin(feature, grouped), 0.5, seen[rng.integers(0, len(seen), inner), feature])
    return DecisionTree.from_complete(
        feature,
        threshold,
        rng.normal(size=(inner + 1, spec.actions.n_outputs)),
        actions=spec.actions,
        feature_names=spec.features.names,
        groups=spec.features.groups,
    )


def playing(arena: Evaluator, trees: list[DecisionTree], episodes: range) -> Callable[[], int]:
    """Play them all; how many steps that were."""
    return lambda: int(arena.play(trees, episodes).lengths.sum(dtype=np.int64))


def rates(calls: dict[str, Callable[[], int]], repeats: int) -> dict[str, Rate]:
    """Of each, in turns; the first round, which compiles, does not count."""
    best = dict.fromkeys(calls, Rate(0, 0))
    for repeat in range(repeats + 1):
        for name, call in calls.items():
            clock, processor = time.perf_counter(), time.process_time()
            steps = call()
            now = Rate(steps / (time.perf_counter() - clock), steps / (time.process_time() - processor))
            if repeat:
                best[name] = Rate(*map(max, now, best[name]))
    return best


def measured(name: str, given: argparse.Namespace) -> dict[str, Rate]:
    """Of one environment."""
    spec = resolve(name)
    num = given.trees if spec.env is not None else given.trees // 8
    episodes = range(given.episodes)
    arenas = {"": make_evaluator(spec, 0)}
    if isinstance(arenas[""], TabularEvaluator):
        arenas = {"": JaxEvaluator(spec, 0), ", looked up": arenas[""]}
    if spec.native is not None:
        arenas[", Gymnasium"] = make_evaluator(resolve(name, backend="host"), 0)
    calls = {
        size + how: playing(arena, random_trees(spec, depth, num), episodes)
        for how, arena in arenas.items()
        for size, depth in DEPTHS.items()
    }
    return rates(calls, given.repeats)


def main() -> None:
    """Measure, print, write."""
    parser = arguments_of(__doc__)
    parser.add_argument("--trees", type=int, default=128, help="compared in one call; on the host an eighth")
    parser.add_argument("--episodes", type=int, default=64, help="that each of them plays")
    parser.add_argument("--repeats", type=int, default=5, help="of each, in turns")
    given = parser.parse_args()
    results: dict[str, Any] = {}
    table = Table("environment", "trees", "steps/s", "steps per second of the processor")
    for env in ENVIRONMENTS:
        rows = measured(env, given)
        results[env] = {size: rate._asdict() for size, rate in rows.items()}
        for size, rate in rows.items():
            table.add_row(env, size, f"{rate.clock:,.0f}", f"{rate.processor:,.0f}")
    Console().print(table)
    settings = {name: getattr(given, name) for name in ("trees", "episodes", "repeats")}
    print(write("arena", {"settings": settings, "environments": results}))


if __name__ == "__main__":
    main()
