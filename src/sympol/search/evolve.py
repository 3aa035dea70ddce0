"""Evolution: mutate trees at random and keep the best of each size.

The archive holds a few trees of each size (as MAP-Elites does, Mouret and Clune 2015, with size as the
descriptor). Its trees are mutated, also in size, and compete with those they could replace, on the same
episodes. Most mutations are for the worse, and a few episodes show it: a quarter of all candidates plays more
episodes, and a quarter of these all of them. Every few generations, an epoch, the episodes change and
everything in the archive is played again, so that nothing stays because it was lucky.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32

from ..seeds import SeedStream
from ..trees import DecisionTree
from .budget import Budget, Meter
from .evaluators.base import Evaluator
from .mutations import Mutator, NestedTree, from_nested, num_nodes, to_nested

ELITES = 4
"""Trees kept of each size."""


@dataclass(frozen=True)
class Entry:
    """A tree and its return in each episode of the present epoch."""

    node: NestedTree
    returns: Float32[np.ndarray, " episodes"]

    @property
    def mean(self) -> float:
        """The mean return of the epoch."""
        return float(self.returns.mean(dtype=np.float64))


def archive_sizes(max_nodes: int) -> tuple[int, ...]:
    """Return the sizes that an archive tells apart: all up to 31 nodes, then ever fewer, and the limit.

    Args:
        max_nodes: The limit of nodes, odd.

    Returns:
        Numbers of nodes, ascending.
    """
    sizes = [1]
    while sizes[-1] < max_nodes:
        sizes.append(sizes[-1] + (1 << max(1, (sizes[-1] + 1).bit_length() - 4)))
    return (*sizes[:-1], max_nodes) if max_nodes > 1 else (1,)


@dataclass
class Archive:
    """The best few trees of each cell; a cell holds trees of its size, or between the cell below and it."""

    sizes: tuple[int, ...]
    entries: dict[int, list[Entry]] = field(default_factory=dict)

    def cell(self, node: NestedTree) -> int:
        """Return the cell that a tree belongs to."""
        return self.sizes[int(np.searchsorted(self.sizes, num_nodes(node)))]

    def all(self) -> list[Entry]:
        """Return every tree, small ones first."""
        return [entry for cell in sorted(self.entries) for entry in self.entries[cell]]

    def to_beat(self, cell: int, episodes: slice) -> float:
        """Return the mean return that a tree must exceed to enter a cell.

        Args:
            cell: The cell.
            episodes: The episodes that the tree has played.

        Returns:
            The mean of the worst tree in the cell, or of the worst of all while the cell has room.
        """
        elites = self.entries.get(cell, [])
        opponents = elites[-1:] if len(elites) == ELITES else self.all()
        return min((float(other.returns[episodes].mean()) for other in opponents), default=0.0)

    def insert(self, entries: Iterable[Entry]) -> None:
        """Keep those that are among the best of their size.

        Of equals the new one is kept, so that mutations that make no difference yet are tried in turn.

        Args:
            entries: Trees that have played all episodes of the epoch.
        """
        touched = set()
        for entry in entries:
            cell = self.cell(entry.node)
            elites = self.entries.setdefault(cell, [])
            if all(entry.node != other.node for other in elites):
                elites.insert(0, entry)
                touched.add(cell)
        for cell in touched:
            self.entries[cell] = sorted(self.entries[cell], key=lambda entry: -entry.mean)[:ELITES]

    def front(self) -> list[int]:
        """Return the cells whose best tree is better than that of every smaller cell."""
        cells, best = [], -np.inf
        for cell in sorted(self.entries):
            if self.entries[cell][0].mean > best:
                best = self.entries[cell][0].mean
                cells.append(cell)
        return cells

    def parents(self, number: int, rng: np.random.Generator) -> Sequence[Entry]:
        """Draw trees to mutate: half of them from the front, the others from anywhere.

        Args:
            number: How many.
            rng: The generator that draws.

        Returns:
            The trees; one may be drawn several times.
        """
        front, anywhere = self.front(), sorted(self.entries)
        chosen = []
        for _ in range(number):
            cell = int(rng.choice(front if rng.random() < 0.5 else anywhere))
            elites = self.entries[cell]
            chosen.append(elites[int(rng.integers(len(elites)))])
        return chosen


CANDIDATES = 192
"""Candidates in a generation."""
ROUNDS = (1 / 16, 1 / 4, 1)
"""The part of an epoch's episodes that candidates have played after each round; the best quarter continues."""
GENERATIONS = 12
"""Generations in an epoch."""
PATIENCE = 4
"""How often mutations are drawn for a generation that has too few new ones."""


class EvolutionResult(NamedTuple):
    """The state of evolution after an epoch, which ``progress`` receives."""

    steps: int
    seconds: float
    best: dict[int, float]
    """The mean return of the best tree of each size, in episodes of the next epoch."""
    trees: list[DecisionTree]
    """The best few of each size."""


Progress: TypeAlias = Callable[[EvolutionResult], object]


def evolve(
    evaluator: Evaluator,
    starts: Sequence[DecisionTree],
    *,
    max_nodes: int,
    budget: Budget,
    episodes: int = 256,
    seed: int = 0,
    progress: Progress | None = None,
) -> EvolutionResult:
    """Mutate trees and keep the best of each size, as long as the budget lasts.

    Args:
        evaluator: The evaluator that plays the trees.
        starts: Trees to start from, at least one; random trees are added.
        max_nodes: The largest number of nodes of the trees that are returned, odd.
        budget: How long to search; it ends with the generation that spends it.
        episodes: Episodes of an epoch.
        seed: With a budget in steps the same seed finds the same trees.
        progress: Called after each epoch.

    Returns:
        The state after the last epoch, with the best few trees of each size. Rank them on held-out episodes.

    Raises:
        ValueError: No tree to start from, or a limit that is even or below 1.
    """
    if not starts:
        raise ValueError("evolution needs at least one tree to start from, be it a single leaf")
    if max_nodes < 1 or max_nodes % 2 == 0:
        raise ValueError(
            f"max_nodes must be odd and at least 1, as trees have an odd number of nodes, got {max_nodes}"
        )
    limit = max(
        max_nodes, *(tree.n_nodes for tree in starts)
    )  # from a large tree to small ones, step by step
    search = _Search(evaluator, starts[0], limit, episodes, SeedStream(seed).generator())
    meter = Meter(evaluator)
    search.begin([to_nested(tree) for tree in starts])

    def epoch() -> EvolutionResult:
        elites = {cell: some for cell, some in sorted(search.archive.entries.items()) if cell <= max_nodes}
        best = {cell: entries[0].mean for cell, entries in elites.items()}
        trees = [from_nested(entry.node, starts[0]) for entries in elites.values() for entry in entries]
        return EvolutionResult(meter.steps, meter.seconds, best, trees)

    while meter.has(budget):
        for _ in range(GENERATIONS):
            if meter.has(budget):
                search.generation()
        search.next_epoch()
        if progress is not None:
            progress(epoch())
    return epoch()


class _Search:
    """The state of an evolution."""

    def __init__(
        self, evaluator: Evaluator, like: DecisionTree, limit: int, episodes: int, rng: np.random.Generator
    ) -> None:
        self.evaluator, self.like, self.rng, self.limit = evaluator, like, rng, limit
        self.archive = Archive(archive_sizes(limit))
        self.epoch = range(episodes)
        self.tried: set[NestedTree] = set()
        """Trees played in this epoch: one that did not enter the archive would not enter it now."""
        self.mutator: Mutator

    def begin(self, starts: list[NestedTree]) -> None:
        """Fill the first archive with the starts and with random trees."""
        self._observe([from_nested(node, self.like) for node in starts[:4]])
        leaves: list[NestedTree] = [self.mutator.random_leaf(self.rng) for _ in range(8)]
        random = [self._changed(leaf, leaves, times=1 + i % 6) for i, leaf in enumerate(leaves * 12)]
        self.archive.insert(self._entries(self._within([*starts, *leaves])))
        self.archive.insert(self._halve(self._within(random)))

    def generation(self) -> None:
        """Try mutations of the archive's trees."""
        elites = [entry.node for entry in self.archive.all()]
        self.tried.update(elites)
        new: list[NestedTree] = []
        for _ in range(PATIENCE):
            parents = self.archive.parents(CANDIDATES - len(new), self.rng)
            changed = self._within([self._changed(parent.node, elites) for parent in parents])
            new += [node for node in changed if node not in self.tried]
            self.tried.update(new)
        self.archive.insert(self._halve(new))

    def next_epoch(self) -> None:
        """Change the episodes, and play all trees of the archive on them."""
        self.epoch = range(self.epoch.stop, self.epoch.stop + len(self.epoch))
        self.tried.clear()
        elites = [entry.node for entry in self.archive.all()]
        self.archive = Archive(self.archive.sizes)
        self.archive.insert(self._entries(elites))
        front = [self.archive.entries[cell][0] for cell in self.archive.front()]
        self._observe([from_nested(entry.node, self.like) for entry in front])

    def _halve(self, nodes: list[NestedTree]) -> list[Entry]:
        """Let ever fewer candidates play more and more episodes; return those that played all."""
        returns = np.zeros((len(nodes), 0), np.float32)
        for part in ROUNDS:
            if not nodes:
                return []
            played, until = returns.shape[1], max(1, round(part * len(self.epoch)))
            more = self._play(nodes, self.epoch[played:until])
            returns = np.concatenate([returns, more], axis=1)
            if until < len(self.epoch):
                margins = [
                    float(row.mean()) - self.archive.to_beat(self.archive.cell(node), slice(until))
                    for row, node in zip(returns, nodes, strict=True)
                ]
                order = np.argsort(-np.array(margins), kind="stable")[: max(1, len(nodes) // 4)]
                nodes, returns = [nodes[i] for i in order], returns[order]
        return [Entry(node, row) for node, row in zip(nodes, returns, strict=True)]

    def _entries(self, nodes: list[NestedTree]) -> list[Entry]:
        return [Entry(node, row) for node, row in zip(nodes, self._play(nodes, self.epoch), strict=True)]

    def _play(self, nodes: list[NestedTree], episodes: range) -> np.ndarray:
        return self.evaluator.play([from_nested(node, self.like) for node in nodes], episodes).returns

    def _changed(self, node: NestedTree, others: Sequence[NestedTree], times: int = 1) -> NestedTree:
        for _ in range(times):
            node = self.mutator.mutate(node, others, self.rng)
        return node

    def _within(self, nodes: list[NestedTree]) -> list[NestedTree]:
        """Return those that are not too large, each once."""
        return list(dict.fromkeys(node for node in nodes if num_nodes(node) <= self.limit))

    def _observe(self, trees: list[DecisionTree]) -> None:
        """Let mutations make a difference among what these trees observe."""
        few = self.epoch[:8]
        seen = np.concatenate([self.evaluator.observe(tree, few) for tree in trees])
        self.mutator = Mutator.for_observations(self.like.actions, seen)
