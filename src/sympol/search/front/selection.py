"""From everything that was found to the front: validation, digits, and one test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from ...envs.spec import EnvSpec
from ...play import play
from ...trees import DecisionTree
from ..archive import cells
from ..evaluators.base import Arena, make_arena
from ..prune_by_return import COMPILED
from ..round_thresholds import round_thresholds
from .candidates import Found
from .config import Plan
from .front import Candidate, Front, Point, Spent, non_dominated

TEST_SEED = 1
"""Of test episodes, as of `sympol train`."""
EPISODES = {"jax": (256, 2048), "native": (32, 512), "host": (8, 64)}
"""Of validation: for all that was found, and for the best of each size."""
FINALISTS = {"jax": 4, "native": 2, "host": 2}
"""Of each size."""


def choose(plan: Plan, spec: EnvSpec, found: Sequence[Found], spent: Spent) -> Front:
    """The front of what was found, chosen by validation episodes, then tested.

    All play a few episodes, the best few of each size many others; these alone decide. Then thresholds
    are rounded where that costs nothing. What this takes is added to ``spent``, what all roads have cost.
    """
    arena = make_arena(spec, plan.seed, "validation")
    listed = spec.all_observations()
    pruned = [replace(one, tree=one.tree.prune(observations=listed)) for one in found]
    fit = _distinct([one for one in pruned if one.tree.n_nodes <= plan.max_nodes])
    few, many = EPISODES[spec.backend]
    means = arena.play([one.tree for one in fit], range(few)).returns.mean(axis=1)
    best = _best_of_each_size(fit, means, cells(plan.max_nodes), FINALISTS[spec.backend])
    shown = _front_of(plan, arena, best, range(few, few + many))
    rounding = make_arena(spec, plan.seed)
    if spec.env is not None:  # elsewhere it takes longer than the search
        effort = COMPILED._replace(last=many)
        rounded = [replace(one, tree=round_thresholds(one.tree, rounding, effort=effort)) for one, _ in shown]
        shown = _front_of(plan, arena, rounded, range(few, few + many))
    front = [point for _, point in shown]
    episodes = len(fit) * few + len(best) * many
    spent += Spent(env_steps=arena.steps + rounding.steps, selection_episodes=episodes)
    tried = [Candidate(one.tree.n_nodes, float(mean), one.road) for one, mean in zip(fit, means, strict=True)]
    return Front(
        environment=spec.name,
        seed=plan.seed,
        points=tuple(front),
        candidates=tuple(tried),
        spent=spent,
        budget={"budget": plan.budget, "roads": list(plan.roads), "max_nodes": plan.max_nodes},
    )


def test(front: Front, spec: EnvSpec, episodes: int) -> Front:
    """The front with each of its trees tested on Gymnasium, on episodes that nothing was chosen by."""
    if spec.make_host is None:
        return front
    points = []
    for point in front.points:
        played = play(point.tree, spec, episodes, seed=TEST_SEED)
        tree = point.tree.with_visits(played.observations)
        points.append(replace(point, tree=tree).tested(played.returns))
    return replace(front, points=tuple(points))


def _distinct(found: Sequence[Found]) -> list[Found]:
    first: dict[DecisionTree, Found] = {}
    for one in found:
        first.setdefault(replace(one.tree, n_node_samples=None), one)
    return list(first.values())


def _best_of_each_size(
    found: Sequence[Found], means: Float32[np.ndarray, " trees"], sizes: Sequence[int], number: int
) -> list[Found]:
    by_size: dict[int, list[int]] = {}
    for i in np.argsort(-means, kind="stable").tolist():
        by_size.setdefault(int(np.searchsorted(sizes, found[i].tree.n_nodes)), []).append(i)
    return [found[i] for kept in by_size.values() for i in kept[:number]]


def _front_of(plan: Plan, arena: Arena, found: Sequence[Found], episodes: range) -> list[tuple[Found, Point]]:
    """The front of these trees in these episodes, and where its points come from."""
    returns = arena.play([one.tree for one in found], episodes).returns
    made = [
        (one, Point.of(one.tree, row, road=one.road, seed=plan.seed, spent=one.spent))
        for one, row in zip(found, returns, strict=True)
    ]
    front = {id(point) for point in non_dominated([point for _, point in made])}
    return sorted(((one, point) for one, point in made if id(point) in front), key=lambda pair: pair[1].nodes)
