"""Several whole runs of one task: what trees of at most so many nodes earn, on average over runs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from .front import Front, FrontError, Point

if TYPE_CHECKING:
    from ...results.statistics import Interval


class AtMost(NamedTuple):
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


def summarise(fronts: Sequence[Front], sizes: Iterable[int]) -> list[AtMost]:
    """What the runs reached with at most each of ``sizes`` nodes, in the tests.

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


def _at_most(fronts: Sequence[Front], size: int) -> AtMost:
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
        return AtMost(size, runs, None, None, None)
    return AtMost(size, runs, *moments(means)[1:], mean_interval(means))
