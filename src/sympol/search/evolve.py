"""Evolution: mutate trees at random and keep the best of each size.

The archive holds a few trees of each size (as MAP-Elites does, Mouret and Clune 2015, with size as the
descriptor). Its trees are mutated, also in size, and compete with those they could replace, on the same
episodes. Most mutations are for the worse, and a few episodes show it: a quarter of all candidates plays more
episodes, and a quarter of these all of them. Every few generations, an epoch, the episodes change and
everything in the archive is played again, so that nothing stays because it was lucky.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32

from ..seeds import SeedStream
from ..trees import DecisionTree
from .budget import Budget
from .evaluators.base import Evaluator
from .mutations import Mutator, NestedTree, from_nested, num_nodes, to_nested

ELITES = 4
"""Trees kept of each size."""


@dataclass(frozen=True)
class Entry:
    """A tree, and what it earned in each episode of the present epoch."""

    node: NestedTree
    returns: Float32[np.ndarray, " episodes"]

    @property
    def mean(self) -> float:
        """The mean return of the epoch."""
        return float(self.returns.mean(dtype=np.float64))


def archive_sizes(max_nodes: int) -> tuple[int, ...]:
    """Sizes that are told apart: all up to 31 nodes, then ever fewer, and the largest that is asked for."""
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
        """The cell that a tree belongs to."""
        return self.sizes[int(np.searchsorted(self.sizes, num_nodes(node)))]

    def all(self) -> list[Entry]:
        """Every tree, small ones first."""
        return [entry for cell in sorted(self.entries) for entry in self.entries[cell]]

    def to_beat(self, cell: int, episodes: slice) -> float:
        """Return the mean return of the worst tree kept in a cell, or of all trees while the cell has room."""
        kept = self.entries.get(cell, [])
        rivals = kept[-1:] if len(kept) == ELITES else self.all()
        return min((float(rival.returns[episodes].mean()) for rival in rivals), default=0.0)

    def insert(self, entries: Iterable[Entry]) -> None:
        """Keep those that are among the best of their size; of equals the new one, so that what makes no difference
        yet is tried in turn."""
        touched = set()
        for entry in entries:
            cell = self.cell(entry.node)
            kept = self.entries.setdefault(cell, [])
            if all(entry.node != other.node for other in kept):
                kept.insert(0, entry)
                touched.add(cell)
        for cell in touched:
            self.entries[cell] = sorted(self.entries[cell], key=lambda entry: -entry.mean)[:ELITES]

    def front(self) -> list[int]:
        """Cells whose best tree is better than that of every smaller cell."""
        found, best = [], -np.inf
        for cell in sorted(self.entries):
            if self.entries[cell][0].mean > best:
                best = self.entries[cell][0].mean
                found.append(cell)
        return found

    def parents(self, number: int, rng: np.random.Generator) -> Sequence[Entry]:
        """Trees to change: half of them from the front, the others from anywhere."""
        front, anywhere = self.front(), sorted(self.entries)
        chosen = []
        for _ in range(number):
            cell = int(rng.choice(front if rng.random() < 0.5 else anywhere))
            kept = self.entries[cell]
            chosen.append(kept[int(rng.integers(len(kept)))])
        return chosen


CANDIDATES = 192
"""Candidates in a generation."""
ROUNDS = (1 / 16, 1 / 4, 1)
"""The part of an epoch's episodes that candidates have played after each round; the best quarter continues."""
GENERATIONS = 12
"""Generations in an epoch."""
PATIENCE = 4
"""How often changes are drawn for a generation that has too few new ones."""


class EvolutionResult(NamedTuple):
    """The state of evolution after an epoch, which ``progress`` receives."""

    steps: int
    seconds: float
    best: dict[int, float]
    """The mean return of the best tree of each size, in other episodes than it was found in."""
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
    """Search from some trees, and from random ones; return the last epoch.

    It has the best few trees of each size up to ``max_nodes``; which of them is best is for episodes to say that the
    search has not seen. ``episodes`` are those of an epoch. With a budget in steps the same seed finds the same trees.

    Raises:
        ValueError: no tree to say what is seen and done, or a limit that is even or below one.
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
    began, spent = time.perf_counter(), evaluator.steps
    search.begin([to_nested(tree) for tree in starts])

    def epoch() -> EvolutionResult:
        kept = {cell: entries for cell, entries in search.archive.entries.items() if cell <= max_nodes}
        best = {cell: entries[0].mean for cell, entries in sorted(kept.items())}
        trees = [
            from_nested(entry.node, starts[0]) for _, entries in sorted(kept.items()) for entry in entries
        ]
        return EvolutionResult(evaluator.steps - spent, time.perf_counter() - began, best, trees)

    def has_budget() -> bool:
        return evaluator.steps - spent < budget.steps and time.perf_counter() - began < budget.seconds

    while has_budget():
        for _ in range(GENERATIONS):
            if has_budget():
                search.generation()
        search.next_epoch()
        if progress is not None:
            progress(epoch())
    return epoch()


class _Search:
    """What evolution knows."""

    def __init__(
        self, evaluator: Evaluator, like: DecisionTree, limit: int, episodes: int, rng: np.random.Generator
    ) -> None:
        self.evaluator, self.like, self.rng, self.limit = evaluator, like, rng, limit
        self.archive = Archive(archive_sizes(limit))
        self.epoch = range(episodes)
        self.tried: set[NestedTree] = set()
        """Trees played in this epoch: one that was not kept then would not be kept now."""
        self.mutator: Mutator

    def begin(self, starts: list[NestedTree]) -> None:
        """The first archive: what is given, and random trees besides."""
        self._look_around([from_nested(node, self.like) for node in starts[:4]])
        leaves: list[NestedTree] = [self.mutator.random_leaf(self.rng) for _ in range(8)]
        random = [self._changed(leaf, leaves, times=1 + i % 6) for i, leaf in enumerate(leaves * 12)]
        self.archive.insert(self._entries(self._within([*starts, *leaves])))
        self.archive.insert(self._race(self._within(random)))

    def generation(self) -> None:
        """Try changes of what is kept."""
        kept = [entry.node for entry in self.archive.all()]
        self.tried.update(kept)
        new: list[NestedTree] = []
        for _ in range(PATIENCE):
            parents = self.archive.parents(CANDIDATES - len(new), self.rng)
            changed = self._within([self._changed(parent.node, kept) for parent in parents])
            new += [node for node in changed if node not in self.tried]
            self.tried.update(new)
        self.archive.insert(self._race(new))

    def next_epoch(self) -> None:
        """Other episodes: whatever is kept plays them."""
        self.epoch = range(self.epoch.stop, self.epoch.stop + len(self.epoch))
        self.tried.clear()
        kept = [entry.node for entry in self.archive.all()]
        self.archive = Archive(self.archive.sizes)
        self.archive.insert(self._entries(kept))
        front = [self.archive.entries[cell][0] for cell in self.archive.front()]
        self._look_around([from_nested(entry.node, self.like) for entry in front])

    def _race(self, nodes: list[NestedTree]) -> list[Entry]:
        """Let candidates play more and more episodes, ever fewer of them; those that played all."""
        returns = np.zeros((len(nodes), 0), np.float32)
        for part in ROUNDS:
            if not nodes:
                return []
            played, until = returns.shape[1], max(1, round(part * len(self.epoch)))
            more = self._play(nodes, self.epoch[played:until])
            returns = np.concatenate([returns, more], axis=1)
            if until < len(self.epoch):
                worth = [
                    float(row.mean()) - self.archive.to_beat(self.archive.cell(node), slice(until))
                    for row, node in zip(returns, nodes, strict=True)
                ]
                order = np.argsort(-np.array(worth), kind="stable")[: max(1, len(nodes) // 4)]
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
        """Those that are not too large, each once."""
        return list(dict.fromkeys(node for node in nodes if num_nodes(node) <= self.limit))

    def _look_around(self, trees: list[DecisionTree]) -> None:
        """See what these trees see."""
        few = self.epoch[:8]
        seen = np.concatenate([self.evaluator.observe(tree, few) for tree in trees])
        self.mutator = Mutator.for_observations(self.like.actions, seen)
