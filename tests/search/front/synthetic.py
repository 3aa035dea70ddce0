"""Fronts that nobody searched for, and one tree that really holds the pole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sympol.search.budget import Cost
from sympol.search.front.front import Front, Point, ReturnSummary
from sympol.trees import DecisionTree
from sympol.trees.actions import DiscreteActions

NAMES = ("cart position", "cart velocity", "pole angle", "pole angular velocity")
SPENT = Cost(1_230_000, 50_000, 640, 12.5)


def chain(nodes: int) -> DecisionTree:
    """A tree of so many nodes that asks one thing after another."""
    depth = nodes // 2
    left, right = np.full(nodes, -1), np.full(nodes, -1)
    feature, threshold, value = np.full(nodes, -2), np.full(nodes, -2.0), np.zeros((nodes, 2))
    for i in range(depth):
        at = 2 * i
        left[at], right[at], feature[at], threshold[at] = at + 1, at + 2, i % 4, i / 8
        value[at + 1, i % 2] = 1
    value[-1, depth % 2] = 1
    return DecisionTree(
        left, right, feature, threshold, value, actions=DiscreteActions(2, names=("push left", "push right")),
        feature_names=NAMES, feature_low=np.full(4, -np.inf), feature_high=np.full(4, np.inf),
    )  # fmt: skip


def steady() -> DecisionTree:
    """Five nodes that hold the pole of CartPole for 500 steps, nearly always."""
    return DecisionTree.from_text(
        "pole angle ≤ 0.0217\n"
        "├─ yes: cart velocity ≤ -0.499\n│  ├─ yes: push right\n│  └─ no:  push left\n"
        "└─ no:  push right",
        like=chain(3),
    )


def returns(mean: float, spread: float = 1.0) -> ReturnSummary:
    return ReturnSummary(100, mean, 5 * spread, mean - spread, mean + spread)


def point(
    nodes: int, mean: float, *, method: str = "scratch", test: float | None = None, **parts: Any
) -> Point:
    """A point with a validation return of ``mean``, tested unless ``test`` is NaN."""
    tested = None if test is not None and np.isnan(test) else returns(mean - 1 if test is None else test)
    made: dict[str, Any] = {"method": method, "seed": 0, "cost": SPENT, "test": tested}
    return Point(chain(nodes), returns(mean), **made | parts)


def front(points: Sequence[Point], *, seed: int = 0, environment: str = "CartPole-v1", **parts: Any) -> Front:
    made: dict[str, Any] = {
        "versions": {"sympol": "0"},
        "commit": "abcdef0123456789",
        "date": "2026-11-22T10:00:00+00:00",
    }
    return Front(environment, seed, tuple(points), cost=SPENT, **made | parts)


def ladder(seed: int = 0, *, environment: str = "CartPole-v1", shift: float = 0.0) -> Front:
    """Points of 1, 5, 7 and 31 nodes by two methods."""
    rows = [(1, 9.0, "scratch"), (5, 400.0, "teacher"), (7, 450.0, "scratch"), (31, 500.0, "teacher")]
    points = [point(nodes, mean + shift, method=method) for nodes, mean, method in rows]
    return front(points, seed=seed, environment=environment)
