"""Selection of the front among all candidates: validation, rounding, and one test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float32

from ...envs.spec import EnvSpec
from ...play import play
from ...trees import DecisionTree
from ..budget import Cost
from ..evaluators import Evaluator, make_evaluator
from ..evolve import archive_sizes
from ..prune_by_return import COMPILED
from ..round_thresholds import round_thresholds
from .config import SearchConfig
from .front import EvaluatedCandidate, Front, Point, non_dominated
from .messages import Candidate

TEST_SEED = 1
"""The seed of test episodes, as in `sympol train`."""
EPISODES = {"jax": (256, 2048), "native": (32, 512), "host": (8, 64)}
"""Validation episodes by backend: for all candidates, and for the finalists of each size."""
FINALISTS = {"jax": 4, "native": 2, "host": 2}
"""Finalists of each size, by backend."""


def select_front(config: SearchConfig, spec: EnvSpec, candidates: Sequence[Candidate], cost: Cost) -> Front:
    """Select the front of all candidates by their returns in validation episodes.

    All play a few episodes, the best few of each size many others; these alone decide. Then thresholds are rounded
    where that costs nothing.

    Args:
        config: The configuration of the search.
        spec: Its environment.
        candidates: The candidates of all methods, at least one.
        cost: The cost of all methods together.

    Returns:
        The front, not yet tested. Its cost includes that of the selection.
    """
    evaluator = make_evaluator(spec, config.seed, "validation")
    listed = spec.all_observations()
    pruned = [replace(one, tree=one.tree.prune(observations=listed)) for one in candidates]
    fit = _distinct([one for one in pruned if one.tree.n_nodes <= config.max_nodes])
    few, many = EPISODES[spec.backend]
    means = evaluator.play([one.tree for one in fit], range(few)).returns.mean(axis=1)
    finalists = _best_of_each_size(fit, means, archive_sizes(config.max_nodes), FINALISTS[spec.backend])
    front = _front_of(config, evaluator, finalists, range(few, few + many))
    rounding = make_evaluator(spec, config.seed)
    if spec.env is not None:  # elsewhere it takes longer than the search
        effort = COMPILED._replace(last=many)
        rounded = [replace(one, tree=round_thresholds(one.tree, rounding, effort=effort)) for one, _ in front]
        front = _front_of(config, evaluator, rounded, range(few, few + many))
    episodes = len(fit) * few + len(finalists) * many
    cost += Cost(env_steps=evaluator.steps + rounding.steps, selection_episodes=episodes)
    evaluated = [
        EvaluatedCandidate(one.tree.n_nodes, float(mean), one.method)
        for one, mean in zip(fit, means, strict=True)
    ]
    return Front(
        environment=spec.name,
        seed=config.seed,
        points=tuple(point for _, point in front),
        candidates=tuple(evaluated),
        cost=cost,
        budget={"budget": config.budget, "methods": list(config.methods), "max_nodes": config.max_nodes},
    )


def test_points(front: Front, spec: EnvSpec, episodes: int) -> Front:
    """Test each tree of a front on Gymnasium, on episodes by which nothing was chosen.

    Args:
        front: A front that was not tested.
        spec: Its environment.
        episodes: The number of test episodes of each tree.

    Returns:
        The tested front.
    """
    points = []
    for point in front.points:
        played = play(point.tree, spec, episodes, seed=TEST_SEED)
        tree = point.tree.with_visits(played.observations)
        points.append(replace(point, tree=tree).tested(played.returns))
    return replace(front, points=tuple(points))


def _distinct(candidates: Sequence[Candidate]) -> list[Candidate]:
    first: dict[DecisionTree, Candidate] = {}
    for one in candidates:
        first.setdefault(replace(one.tree, n_node_samples=None), one)
    return list(first.values())


def _best_of_each_size(
    candidates: Sequence[Candidate], means: Float32[np.ndarray, " trees"], sizes: Sequence[int], number: int
) -> list[Candidate]:
    by_size: dict[int, list[int]] = {}
    for i in np.argsort(-means, kind="stable").tolist():
        by_size.setdefault(int(np.searchsorted(sizes, candidates[i].tree.n_nodes)), []).append(i)
    return [candidates[i] for ranked in by_size.values() for i in ranked[:number]]


def _front_of(
    config: SearchConfig, evaluator: Evaluator, candidates: Sequence[Candidate], episodes: range
) -> list[tuple[Candidate, Point]]:
    """Return the front of these candidates in these episodes, each with its point."""
    returns = evaluator.play([one.tree for one in candidates], episodes).returns
    points = [
        (one, Point.of(one.tree, row, method=one.method, seed=config.seed, cost=one.cost))
        for one, row in zip(candidates, returns, strict=True)
    ]
    front = {id(point) for point in non_dominated([point for _, point in points])}
    return sorted(
        ((one, point) for one, point in points if id(point) in front), key=lambda pair: pair[1].nodes
    )
