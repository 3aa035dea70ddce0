"""Selection of the front among all candidates: validation, rounding, and one test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from ...envs.spec import EnvSpec
from ...play import play
from ...trees import DecisionTree
from ..evaluators import Evaluator, make_evaluator
from ..evolve import archive_sizes
from ..prune_by_return import COMPILED
from ..round_thresholds import round_thresholds
from .candidates import Candidate
from .config import SearchConfig
from .front import Cost, EvaluatedCandidate, Front, Point, non_dominated

TEST_SEED = 1
"""Of test episodes, as of `sympol train`."""
EPISODES = {"jax": (256, 2048), "native": (32, 512), "host": (8, 64)}
"""Of validation: for all that was found, and for the best of each size."""
FINALISTS = {"jax": 4, "native": 2, "host": 2}
"""Of each size."""


def select_front(plan: SearchConfig, spec: EnvSpec, found: Sequence[Candidate], spent: Cost) -> Front:
    """Select the front of all candidates by their returns in validation episodes.

    All play a few episodes, the best few of each size many others; these alone decide. Then thresholds
    are rounded where that costs nothing. What this takes is added to ``spent``, the cost of all methods.
    """
    evaluator = make_evaluator(spec, plan.seed, "validation")
    listed = spec.all_observations()
    pruned = [replace(one, tree=one.tree.prune(observations=listed)) for one in found]
    fit = _distinct([one for one in pruned if one.tree.n_nodes <= plan.max_nodes])
    few, many = EPISODES[spec.backend]
    means = evaluator.play([one.tree for one in fit], range(few)).returns.mean(axis=1)
    best = _best_of_each_size(fit, means, archive_sizes(plan.max_nodes), FINALISTS[spec.backend])
    shown = _front_of(plan, evaluator, best, range(few, few + many))
    rounding = make_evaluator(spec, plan.seed)
    if spec.env is not None:  # elsewhere it takes longer than the search
        effort = COMPILED._replace(last=many)
        rounded = [replace(one, tree=round_thresholds(one.tree, rounding, effort=effort)) for one, _ in shown]
        shown = _front_of(plan, evaluator, rounded, range(few, few + many))
    front = [point for _, point in shown]
    episodes = len(fit) * few + len(best) * many
    spent += Cost(env_steps=evaluator.steps + rounding.steps, selection_episodes=episodes)
    tried = [
        EvaluatedCandidate(one.tree.n_nodes, float(mean), one.method)
        for one, mean in zip(fit, means, strict=True)
    ]
    return Front(
        environment=spec.name,
        seed=plan.seed,
        points=tuple(front),
        candidates=tuple(tried),
        cost=spent,
        budget={"budget": plan.budget, "roads": list(plan.methods), "max_nodes": plan.max_nodes},
    )


def test(front: Front, spec: EnvSpec, episodes: int) -> Front:
    """Test each tree of a front on Gymnasium, on episodes by which nothing was chosen; return the tested front."""
    if spec.make_host is None:
        return front
    points = []
    for point in front.points:
        played = play(point.tree, spec, episodes, seed=TEST_SEED)
        tree = point.tree.with_visits(played.observations)
        points.append(replace(point, tree=tree).tested(played.returns))
    return replace(front, points=tuple(points))


def _distinct(found: Sequence[Candidate]) -> list[Candidate]:
    first: dict[DecisionTree, Candidate] = {}
    for one in found:
        first.setdefault(replace(one.tree, n_node_samples=None), one)
    return list(first.values())


def _best_of_each_size(
    found: Sequence[Candidate], means: Float32[np.ndarray, " trees"], sizes: Sequence[int], number: int
) -> list[Candidate]:
    by_size: dict[int, list[int]] = {}
    for i in np.argsort(-means, kind="stable").tolist():
        by_size.setdefault(int(np.searchsorted(sizes, found[i].tree.n_nodes)), []).append(i)
    return [found[i] for kept in by_size.values() for i in kept[:number]]


def _front_of(
    plan: SearchConfig, evaluator: Evaluator, found: Sequence[Candidate], episodes: range
) -> list[tuple[Candidate, Point]]:
    """The front of these trees in these episodes, and where its points come from."""
    returns = evaluator.play([one.tree for one in found], episodes).returns
    made = [
        (one, Point.of(one.tree, row, method=one.method, seed=plan.seed, cost=one.cost))
        for one, row in zip(found, returns, strict=True)
    ]
    front = {id(point) for point in non_dominated([point for _, point in made])}
    return sorted(((one, point) for one, point in made if id(point) in front), key=lambda pair: pair[1].nodes)
