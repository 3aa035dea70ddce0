"""The front of return against size: the trees that beat every tree of at most their size.

A tree is chosen by its return in validation episodes, and tested once, on episodes by which nothing was chosen.
Over several whole runs of one task, `best_under_sizes` averages what each run reached within a number of nodes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...trees import DecisionTree

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ...results.statistics import Interval


class FrontError(ValueError):
    """A front that cannot be: the message names the value, the rule and the remedy."""


def _count(name: str, value: Any, *, least: int = 0) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise FrontError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(value)


def _finite(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not math.isfinite(value):
        raise FrontError(f"{name} must be a finite number, got {value!r}")
    return float(value)


@dataclass(frozen=True)
class Cost:
    """The cost of a tree or a search; costs can be added."""

    env_steps: int = 0
    """Environment steps of trainings and searches, and of choosing; not a teacher's, and not those of tests."""
    teacher_steps: int = 0
    """Environment steps that teachers were trained with."""
    selection_episodes: int = 0
    """Episodes that something was chosen by."""
    seconds: float = 0.0

    def __post_init__(self) -> None:
        """Check; raises FrontError."""
        for name in ("env_steps", "teacher_steps", "selection_episodes"):
            object.__setattr__(self, name, _count(name, getattr(self, name)))
        object.__setattr__(self, "seconds", _finite("seconds", self.seconds))
        if self.seconds < 0:
            raise FrontError(f"seconds must not be negative, got {self.seconds}")

    @property
    def steps(self) -> int:
        """Environment steps, a teacher's among them."""
        return self.env_steps + self.teacher_steps

    def __add__(self, other: Cost) -> Cost:
        """Both together."""
        return Cost(*(getattr(self, part.name) + getattr(other, part.name) for part in fields(self)))


@dataclass(frozen=True)
class ReturnSummary:
    """Statistics of the undiscounted returns of a tree."""

    episodes: int
    mean: float
    std: float
    """Over episodes (ddof 1)."""
    low: float
    """Of Student's 95 % interval of the mean over episodes: how far luck with episodes moved it."""
    high: float

    def __post_init__(self) -> None:
        """Check; raises FrontError."""
        object.__setattr__(self, "episodes", _count("episodes", self.episodes, least=2))
        for name in ("mean", "std", "low", "high"):
            object.__setattr__(self, name, _finite(name, getattr(self, name)))
        if self.std < 0 or not self.low <= self.mean <= self.high:
            raise FrontError(
                f"a mean must lie in its interval and a deviation not be negative, got {self.mean} in "
                f"[{self.low}, {self.high}] ± {self.std}; make them of returns: ReturnSummary.of(returns)"
            )

    @classmethod
    def of(cls, returns: ArrayLike) -> ReturnSummary:
        """Sum up the returns of episodes, at least two of them.

        Raises:
            FrontError: fewer, or a return that is not finite.
        """
        from ...results.statistics import mean_interval, moments  # SciPy is slow to import

        values = np.asarray(returns, float)
        if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
            raise FrontError(
                f"returns must be finite and of at least 2 episodes, a list, got {values.tolist()!r:.60}; one episode "
                "has no interval"
            )
        _, mean, std = moments(values)
        bounds = mean_interval(values)
        assert std is not None
        assert bounds is not None
        return cls(len(values), mean, std, bounds.low, bounds.high)


@dataclass(frozen=True)
class Point:
    """One tree, how it was made, and what it earned."""

    tree: DecisionTree
    validation: ReturnSummary
    """Of episodes that it may have been chosen by: a little too good, the more so the more trees were tried."""
    method: str
    """How it was made, in words: "scratch", "teacher + shrink", …."""
    seed: int
    """Of the run that it comes from."""
    cost: Cost = Cost()
    """On the way to this tree; what ways have in common counts in each."""
    test: ReturnSummary | None = None
    """Of episodes that nothing was chosen by."""

    def __post_init__(self) -> None:
        """Check; raises FrontError."""
        if not self.method or not self.method.isprintable():
            raise FrontError(
                f'a method must be a few words on one line, such as "scratch", got {self.method!r}'
            )
        object.__setattr__(self, "seed", _count("seed", self.seed))

    @classmethod
    def of(
        cls,
        tree: DecisionTree,
        returns: ArrayLike,
        *,
        method: str,
        seed: int,
        cost: Cost = Cost(),
        test_returns: ArrayLike | None = None,
    ) -> Point:
        """Make one of the ``returns [episodes]`` of validation, and of those of the test if there was one."""
        test = None if test_returns is None else ReturnSummary.of(test_returns)
        return cls(tree, ReturnSummary.of(returns), method, seed, cost, test)

    def tested(self, returns: ArrayLike) -> Point:
        """The same one with the ``returns [episodes]`` of its test, which is done once.

        Raises:
            FrontError: it has been tested.
        """
        if self.test is not None:
            raise FrontError(
                f"the tree of {self.nodes} nodes has been tested; testing again would choose among tests"
            )
        return replace(self, test=ReturnSummary.of(returns))

    @property
    def nodes(self) -> int:
        """Inner nodes and leaves."""
        return self.tree.n_nodes

    @property
    def mean(self) -> float:
        """The mean validation return."""
        return self.validation.mean

    @property
    def interval(self) -> tuple[float, float]:
        """Student's 95 % interval of the mean over validation episodes."""
        return self.validation.low, self.validation.high


class EvaluatedCandidate(NamedTuple):
    """A tree that was tried: enough of it to be drawn behind the front."""

    nodes: int
    mean: float
    """Of validation."""
    method: str


def non_dominated(points: Iterable[Point]) -> list[Point]:
    """The points that earn more in validation than every other one of at most their size, the smallest first.

    Means are compared as they are; of two that earn the same the smaller one stays, and of two of the same size the
    one that came first.
    """
    front: list[Point] = []
    for point in sorted(points, key=lambda point: (point.nodes, -point.mean)):
        if not front or point.mean > front[-1].mean:
            front.append(point)
    return front


@dataclass(frozen=True)
class Front:
    """The result of one whole search on one task."""

    environment: str
    seed: int
    points: tuple[Point, ...]
    """The smallest first, each better than those before it: see `non_dominated`."""
    candidates: tuple[EvaluatedCandidate, ...] = ()
    """Everything that was tried, or a part of it, to be drawn behind."""
    cost: Cost = Cost()
    """By the whole run; less than the sum over points, which share their ways."""
    budget: Mapping[str, Any] = field(default_factory=dict)
    """What was granted, such as ``{"seconds": 300}``: plain JSON."""
    versions: Mapping[str, Any] = field(default_factory=dict)
    """Of everything that the result may depend on: `sympol.runs.metadata.versions`."""
    commit: str = ""
    date: str = ""
    """When it was finished, in ISO 8601."""

    def __post_init__(self) -> None:
        """Check; raises FrontError."""
        points = tuple(self.points)
        object.__setattr__(self, "points", points)
        candidates = tuple(
            EvaluatedCandidate(_count("nodes", nodes, least=1), _finite("mean", mean), str(method))
            for nodes, mean, method in self.candidates
        )
        object.__setattr__(self, "candidates", candidates)
        object.__setattr__(self, "seed", _count("seed", self.seed))
        if not points:
            raise FrontError("a front must have points, got none; one leaf is a tree, too")
        if len(non_dominated(points)) < len(points) or list(points) != sorted(points, key=lambda p: p.nodes):
            raise FrontError(
                "points must grow in nodes and in validation return, got "
                f"{[(point.nodes, point.mean) for point in points]}; choose them by non_dominated(points)"
            )

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods of the search, as recorded in ``budget``; none where it lacks them."""
        return tuple(self.budget.get("roads", ()))

    def best(self, max_nodes: int | None = None) -> Point | None:
        """The point that earned most in validation, of those with at most ``max_nodes``; None if there is none."""
        small = [point for point in self.points if max_nodes is None or point.nodes <= max_nodes]
        return small[-1] if small else None


class BestUnderSize(NamedTuple):
    """The best tree of at most ``nodes`` nodes of each run, chosen by validation."""

    nodes: int
    runs: tuple[tuple[int, Point | None], ...]
    """The seed of each run, and its point; None where it has no tree so small."""
    mean: float | None
    """Over runs of their mean test returns; None where a run has no tree so small."""
    std: float | None
    """Over runs (ddof 1); None for a single one."""
    spread: Interval | None
    """The mean with Student's 95 % interval over runs; None for a single one."""


def best_under_sizes(fronts: Sequence[Front], sizes: Iterable[int]) -> list[BestUnderSize]:
    """Return the test returns that runs reached with at most each of ``sizes`` nodes.

    A run counts as one number, its mean test return: the spread is that of whole runs, not of episodes.

    Raises:
        FrontError: no runs, of several tasks, twice the same seed, or a chosen tree that was not tested.
    """
    require_one_task(fronts)
    return [_at_most(fronts, size) for size in sizes]


def require_one_task(fronts: Sequence[Front]) -> str:
    """Return the environment of all runs; raises FrontError where they are of several, or not runs of their own."""
    environments, seeds = {front.environment for front in fronts}, [front.seed for front in fronts]
    if len(environments) != 1:
        raise FrontError(
            f"runs must be of one task, got {', '.join(sorted(environments)) or 'no runs'}; one each"
        )
    if len({*seeds}) < len(seeds):
        raise FrontError(f"runs must have seeds of their own, got {seeds}; the same run twice proves nothing")
    return environments.pop()


def sizes_of(fronts: Iterable[Front]) -> list[int]:
    """Every size that any run has a point of."""
    return sorted({point.nodes for front in fronts for point in front.points})


def _at_most(fronts: Sequence[Front], size: int) -> BestUnderSize:
    from ...results.statistics import mean_interval, moments  # SciPy is slow to import

    runs = tuple((front.seed, front.best(size)) for front in fronts)
    means: list[float] = []
    for seed, point in runs:
        if point is not None and point.test is None:
            raise FrontError(
                f"the tree of {point.nodes} nodes of the run with seed {seed} was not tested; test every point"
            )
        means += [point.test.mean] if point is not None and point.test is not None else []
    if len(means) < len(runs):
        return BestUnderSize(size, runs, None, None, None)
    return BestUnderSize(size, runs, *moments(means)[1:], mean_interval(means))
