"""The front of return against size: the trees that earn more than every other tree of at most their size.

A tree is chosen by its return in validation episodes and tested once, on episodes by which nothing was chosen. Over
several whole runs of one task, `best_under_sizes` averages the returns that each run reached within a number of nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ...trees import DecisionTree
from ..budget import NO_COST, Cost, finite_number, whole_number

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ...results.statistics import Interval

_FORMER_METHODS = {"lookup": "tabular", "shrink": "prune", "polish": "fine-tune"}


class FrontError(ValueError):
    """A front that cannot be: the message names the value, the rule and the remedy."""


def current_method(method: str) -> str:
    """Return the present name of a method that an earlier version saved.

    Args:
        method: Names joined by plus signs, such as ``"lookup + shrink"``.

    Returns:
        The present names, such as ``"tabular + prune"``; other names stay.
    """
    return " + ".join(_FORMER_METHODS.get(part, part) for part in method.split(" + "))


@dataclass(frozen=True)
class ReturnSummary:
    """Statistics of the undiscounted returns of a tree."""

    episodes: int
    mean: float
    std: float
    """The standard deviation over episodes (ddof 1)."""
    low: float
    """The lower end of Student's 95 % interval of the mean over episodes."""
    high: float
    """The upper end."""

    def __post_init__(self) -> None:
        """Check."""
        object.__setattr__(self, "episodes", whole_number("episodes", self.episodes, least=2))
        for name in ("mean", "std", "low", "high"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name)))
        if self.std < 0 or not self.low <= self.mean <= self.high:
            raise FrontError(
                f"a mean must lie in its interval and a deviation not be negative, got {self.mean} in "
                f"[{self.low}, {self.high}] ± {self.std}; make them of returns: ReturnSummary.of(returns)"
            )

    @classmethod
    def of(cls, returns: ArrayLike) -> ReturnSummary:
        """Summarise the returns of episodes.

        Args:
            returns: The undiscounted returns ``[episodes]``, at least two.

        Returns:
            Their statistics.

        Raises:
            FrontError: There are fewer than two, or a return is not finite.
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
    """One tree of a front, how it was made, and its returns."""

    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"road": "method", "spent": "cost"}

    tree: DecisionTree
    validation: ReturnSummary
    """Returns in validation episodes, by which it may have been chosen, and which are therefore optimistic."""
    method: str
    """The methods that made it: "scratch", "teacher + prune", …."""
    seed: int
    """The seed of the search."""
    cost: Cost = NO_COST
    """The cost of producing this tree. Work shared between trees is counted for each of them."""
    test: ReturnSummary | None = None
    """Returns in test episodes, by which nothing was chosen."""

    def __post_init__(self) -> None:
        """Check."""
        if not self.method or not self.method.isprintable():
            raise FrontError(
                f'a method must be a few words on one line, such as "scratch", got {self.method!r}'
            )
        object.__setattr__(self, "seed", whole_number("seed", self.seed))

    @classmethod
    def of(
        cls,
        tree: DecisionTree,
        returns: ArrayLike,
        *,
        method: str,
        seed: int,
        cost: Cost = NO_COST,
        test_returns: ArrayLike | None = None,
    ) -> Point:
        """Make a point of the returns of a tree.

        Args:
            tree: The tree.
            returns: Its validation returns ``[episodes]``.
            method: The methods that made it, in a few words.
            seed: The seed of the search.
            cost: The cost of producing it.
            test_returns: Its test returns ``[episodes]``, if it was tested.

        Returns:
            The point.

        Raises:
            ValueError: Fewer than two returns, or one that is not finite; or no method, or a seed below 0.
        """
        test = None if test_returns is None else ReturnSummary.of(test_returns)
        return cls(tree, ReturnSummary.of(returns), method, seed, cost, test)

    def tested(self, returns: ArrayLike) -> Point:
        """Return this point with the returns of its test, which is done once.

        Args:
            returns: The test returns ``[episodes]``.

        Returns:
            The tested point.

        Raises:
            FrontError: It has been tested already.
        """
        if self.test is not None:
            raise FrontError(
                f"the tree of {self.nodes} nodes has been tested; testing again would choose among tests"
            )
        return replace(self, test=ReturnSummary.of(returns))

    @property
    def nodes(self) -> int:
        """The number of inner nodes and leaves."""
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
    """The size and return of a candidate, to be drawn behind the front."""

    nodes: int
    mean: float
    """The mean return in the first validation episodes."""
    method: str


def non_dominated(points: Iterable[Point]) -> list[Point]:
    """Return the points that earn more in validation than every other one of at most their size.

    Means are compared as they are. Of two that earn the same the smaller one stays, and of two of the same size the
    first one.

    Args:
        points: Any points of one task.

    Returns:
        The points of the front, the smallest first.
    """
    front: list[Point] = []
    for point in sorted(points, key=lambda point: (point.nodes, -point.mean)):
        if not front or point.mean > front[-1].mean:
            front.append(point)
    return front


@dataclass(frozen=True)
class Front:
    """The result of one whole search on one task."""

    FORMER_NAMES: ClassVar[Mapping[str, str]] = {"spent": "cost"}

    environment: str
    seed: int
    points: tuple[Point, ...]
    """The trees, the smallest first, each better than those before it: see `non_dominated`."""
    candidates: tuple[EvaluatedCandidate, ...] = ()
    """All candidates, or some of them, to be drawn behind the front."""
    cost: Cost = NO_COST
    """The cost of the whole search; less than the sum over points, which share work."""
    budget: Mapping[str, Any] = field(default_factory=dict)
    """The budget and the methods, such as ``{"budget": "5m", "methods": ["evolve"]}``: plain JSON."""
    versions: Mapping[str, Any] = field(default_factory=dict)
    """The versions of everything that the result may depend on: `sympol.provenance.versions`."""
    commit: str = ""
    date: str = ""
    """When the search finished, in ISO 8601."""

    def __post_init__(self) -> None:
        """Check."""
        points = tuple(self.points)
        object.__setattr__(self, "points", points)
        candidates = tuple(
            EvaluatedCandidate(
                whole_number("nodes", nodes, least=1), finite_number("mean", mean), str(method)
            )
            for nodes, mean, method in self.candidates
        )
        object.__setattr__(self, "candidates", candidates)
        object.__setattr__(self, "seed", whole_number("seed", self.seed))
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
        return tuple(self.budget.get("methods", ()))

    def best(self, max_nodes: int | None = None) -> Point | None:
        """Return the point that earned most in validation within a limit of nodes.

        Args:
            max_nodes: The limit; by default there is none.

        Returns:
            The point, or None where no tree is so small.
        """
        small = [point for point in self.points if max_nodes is None or point.nodes <= max_nodes]
        return small[-1] if small else None


class BestUnderSize(NamedTuple):
    """The best tree of at most ``nodes`` nodes of each run, chosen by validation."""

    nodes: int
    runs: tuple[tuple[int, Point | None], ...]
    """The seed of each run, and its point; None where it has no tree so small."""
    mean: float | None
    """The mean over runs of their mean test returns; None where a run has no tree so small."""
    std: float | None
    """The standard deviation over runs (ddof 1); None for a single run."""
    spread: Interval | None
    """The mean with Student's 95 % interval over runs; None for a single run."""


def best_under_sizes(fronts: Sequence[Front], sizes: Iterable[int]) -> list[BestUnderSize]:
    """Return the test returns that runs reached within each of some numbers of nodes.

    A run counts as one number, its mean test return: the spread is that of whole runs, not of episodes.

    Args:
        fronts: Runs of one task with different seeds.
        sizes: The numbers of nodes.

    Returns:
        An entry for each size.

    Raises:
        FrontError: No runs, runs of several tasks, the same seed twice, or a chosen tree that was not tested.
    """
    require_one_task(fronts)
    return [_best_under(fronts, size) for size in sizes]


def require_one_task(fronts: Sequence[Front]) -> str:
    """Return the environment of all runs.

    Args:
        fronts: The runs.

    Returns:
        The name of their environment.

    Raises:
        FrontError: There are none, they are of several environments, or two have the same seed.
    """
    environments, seeds = {front.environment for front in fronts}, [front.seed for front in fronts]
    if len(environments) != 1:
        raise FrontError(
            f"runs must be of one task, got {', '.join(sorted(environments)) or 'no runs'}; one each"
        )
    if len({*seeds}) < len(seeds):
        raise FrontError(f"runs must have seeds of their own, got {seeds}; the same run twice proves nothing")
    return environments.pop()


def sizes_of(fronts: Iterable[Front]) -> list[int]:
    """Return every number of nodes of which any run has a point, ascending."""
    return sorted({point.nodes for front in fronts for point in front.points})


def _best_under(fronts: Sequence[Front], size: int) -> BestUnderSize:
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
