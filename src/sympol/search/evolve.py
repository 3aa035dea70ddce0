"""Evolution: change trees at random, keep the best of each size.

An archive holds a few trees of each size (as MAP-Elites does, Mouret and Clune 2015, with size as what tells them
apart). Its trees are changed, also in size, and play against those they could take the place of, in the same
episodes. Most changes are for the worse, and a few episodes show it: of all candidates a quarter goes on to more
episodes, and a quarter of these to all. Every few generations there are other episodes, and all that is kept plays
those, so that nothing is kept for having been lucky.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from ..trees import DecisionTree
from .archive import Archive, Entry, cells
from .evaluators.base import Arena
from .moves import Moves, Plain, plain, size, tree_of

CANDIDATES = 192
"""Of a generation."""
ROUNDS = (1 / 16, 1 / 4, 1)
"""The part of a heat's episodes that candidates have played after each round; a quarter of them goes on."""
GENERATIONS = 12
"""Of a heat."""
PATIENCE = 4
"""How often changes are drawn for a generation that has too few new ones."""


@dataclass(frozen=True)
class Budget:
    """How long to search: until one of the two is spent."""

    steps: float = np.inf
    """Environment steps."""
    seconds: float = np.inf


class Heat(NamedTuple):
    """What ``progress`` is told after each heat."""

    steps: int
    seconds: float
    best: dict[int, float]
    """The mean return of the best tree of each size, in other episodes than it was found in."""
    trees: list[DecisionTree]
    """The best few of each size."""


Progress: TypeAlias = Callable[[Heat], object]


def evolve(
    arena: Arena,
    starts: Sequence[DecisionTree],
    *,
    max_nodes: int,
    budget: Budget,
    episodes: int = 256,
    seed: int = 0,
    progress: Progress | None = None,
) -> Heat:
    """Search from some trees, and from random ones; return the last heat.

    It has the best few trees of each size up to ``max_nodes``; which of them is best is for episodes to say that the
    search has not seen. ``episodes`` are those of a heat. With a budget in steps the same seed finds the same trees.

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
    search = _Search(arena, starts[0], limit, episodes, np.random.default_rng(seed))
    began, spent = time.perf_counter(), arena.steps
    search.begin([plain(tree) for tree in starts])

    def heat() -> Heat:
        kept = {cell: entries for cell, entries in search.archive.entries.items() if cell <= max_nodes}
        best = {cell: entries[0].mean for cell, entries in sorted(kept.items())}
        trees = [tree_of(entry.node, starts[0]) for _, entries in sorted(kept.items()) for entry in entries]
        return Heat(arena.steps - spent, time.perf_counter() - began, best, trees)

    def goes_on() -> bool:
        return arena.steps - spent < budget.steps and time.perf_counter() - began < budget.seconds

    while goes_on():
        for _ in range(GENERATIONS):
            if goes_on():
                search.generation()
        search.next_heat()
        if progress is not None:
            progress(heat())
    return heat()


class _Search:
    """What evolution knows."""

    def __init__(
        self, arena: Arena, like: DecisionTree, limit: int, episodes: int, rng: np.random.Generator
    ) -> None:
        self.arena, self.like, self.rng, self.limit = arena, like, rng, limit
        self.archive = Archive(cells(limit))
        self.heat = range(episodes)
        self.tried: set[Plain] = set()
        """In this heat: whoever was not kept then would not be now."""
        self.moves: Moves

    def begin(self, starts: list[Plain]) -> None:
        """The first archive: what is given, and random trees besides."""
        self._look_around([tree_of(node, self.like) for node in starts[:4]])
        leaves: list[Plain] = [self.moves.leaf(self.rng) for _ in range(8)]
        random = [self._changed(leaf, leaves, times=1 + i % 6) for i, leaf in enumerate(leaves * 12)]
        self.archive.place(self._entries(self._within([*starts, *leaves])))
        self.archive.place(self._race(self._within(random)))

    def generation(self) -> None:
        """Try changes of what is kept."""
        kept = [entry.node for entry in self.archive.all()]
        self.tried.update(kept)
        new: list[Plain] = []
        for _ in range(PATIENCE):
            parents = self.archive.parents(CANDIDATES - len(new), self.rng)
            changed = self._within([self._changed(parent.node, kept) for parent in parents])
            new += [node for node in changed if node not in self.tried]
            self.tried.update(new)
        self.archive.place(self._race(new))

    def next_heat(self) -> None:
        """Other episodes: whatever is kept plays them."""
        self.heat = range(self.heat.stop, self.heat.stop + len(self.heat))
        self.tried.clear()
        kept = [entry.node for entry in self.archive.all()]
        self.archive = Archive(self.archive.sizes)
        self.archive.place(self._entries(kept))
        front = [self.archive.entries[cell][0] for cell in self.archive.front()]
        self._look_around([tree_of(entry.node, self.like) for entry in front])

    def _race(self, nodes: list[Plain]) -> list[Entry]:
        """Let candidates play more and more episodes, ever fewer of them; those that played all."""
        returns = np.zeros((len(nodes), 0), np.float32)
        for part in ROUNDS:
            if not nodes:
                return []
            played, until = returns.shape[1], max(1, round(part * len(self.heat)))
            more = self._play(nodes, self.heat[played:until])
            returns = np.concatenate([returns, more], axis=1)
            if until < len(self.heat):
                worth = [
                    float(row.mean()) - self.archive.to_beat(self.archive.cell(node), slice(until))
                    for row, node in zip(returns, nodes, strict=True)
                ]
                order = np.argsort(-np.array(worth), kind="stable")[: max(1, len(nodes) // 4)]
                nodes, returns = [nodes[i] for i in order], returns[order]
        return [Entry(node, row) for node, row in zip(nodes, returns, strict=True)]

    def _entries(self, nodes: list[Plain]) -> list[Entry]:
        return [Entry(node, row) for node, row in zip(nodes, self._play(nodes, self.heat), strict=True)]

    def _play(self, nodes: list[Plain], episodes: range) -> np.ndarray:
        return self.arena.play([tree_of(node, self.like) for node in nodes], episodes).returns

    def _changed(self, node: Plain, others: Sequence[Plain], times: int = 1) -> Plain:
        for _ in range(times):
            node = self.moves.change(node, others, self.rng)
        return node

    def _within(self, nodes: list[Plain]) -> list[Plain]:
        """Those that are not too large, each once."""
        return list(dict.fromkeys(node for node in nodes if size(node) <= self.limit))

    def _look_around(self, trees: list[DecisionTree]) -> None:
        """See what these trees see."""
        few = self.heat[:8]
        seen = np.concatenate([self.arena.observe(tree, few) for tree in trees])
        self.moves = Moves.among(self.like.actions, seen)
