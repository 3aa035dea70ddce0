"""The best trees of each size, a few of each: what evolution remembers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32

from .moves import Plain, size

ELITES = 4
"""Trees kept of each size."""


@dataclass(frozen=True)
class Entry:
    """A tree, and what it earned in each episode of the present heat."""

    node: Plain
    returns: Float32[np.ndarray, " episodes"]

    @property
    def mean(self) -> float:
        """Of the returns."""
        return float(self.returns.mean(dtype=np.float64))


def cells(max_nodes: int) -> tuple[int, ...]:
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

    def cell(self, node: Plain) -> int:
        """The cell that a tree belongs to."""
        return self.sizes[int(np.searchsorted(self.sizes, size(node)))]

    def all(self) -> list[Entry]:
        """Every tree, small ones first."""
        return [entry for cell in sorted(self.entries) for entry in self.entries[cell]]

    def to_beat(self, cell: int, episodes: slice) -> float:
        """What the worst tree that is kept of a size earns in these episodes; while there is room, of any size."""
        kept = self.entries.get(cell, [])
        rivals = kept[-1:] if len(kept) == ELITES else self.all()
        return min((float(rival.returns[episodes].mean()) for rival in rivals), default=0.0)

    def place(self, entries: Iterable[Entry]) -> None:
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
