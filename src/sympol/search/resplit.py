"""Other questions for a tree that has as many as it may: it grows, is polished, pruned back and polished again.

Polishing moves thresholds, but asks what was asked before; pruning only takes away. Together with growing they change
what a tree asks, and it keeps its size: a quarter more nodes are planted, and the least useful ones go, which need
not be those that were planted. Polished in between, new questions show what they are worth before any has to go.
"""

from __future__ import annotations

import time

import numpy as np

from ..trees import DecisionTree
from .evaluators.base import Arena
from .evolve import Budget
from .finetune_thresholds import polish
from .insert_splits import grow
from .prune_by_return import chain, effort_of

GROWN = 1.25
"""To how many times the limit a tree grows."""
GROWING = 0.5
"""The part of a budget after which it grows no further."""
POLISHING = 1 / 3
"""How long is polished, each time, of what was done before."""
EPISODES = 1 << 20
"""That are played at most; growing begins with the first of them."""
SHRINKING_FROM, JUDGING_FROM, POLISHING_FROM, FINISHING_FROM = 1 << 18, 3 << 17, 1 << 19, 5 << 17


def regrow(
    tree: DecisionTree,
    arena: Arena,
    *,
    max_nodes: int,
    budget: Budget,
    episodes: int = 32,
    first_episode: int = 0,
    seed: int = 0,
) -> DecisionTree:
    """A tree with no more nodes than allowed that earns more; the tree itself where none is found.

    Args:
        tree: as good as polishing makes it.
        arena: where it plays.
        max_nodes: that the tree has no more of either.
        budget: how long to search; pruning may take it further.
        episodes: of a generation of polishing.
        first_episode: `EPISODES` from this number on are played.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.

    Raises:
        ImportError: pycma is not installed.
        ValueError: a tree for other features or actions.
    """
    began, before = time.perf_counter(), arena.steps

    def polished(one: DecisionTree, at: int) -> DecisionTree:
        """For so long as a part of what was taken until now, and no longer than what is left."""
        steps, seconds = arena.steps - before, time.perf_counter() - began
        left = Budget(budget.steps - steps, budget.seconds - seconds)
        return polish(
            [one],
            arena,
            budget=Budget(min(POLISHING * steps, left.steps), left.seconds),
            episodes=episodes,
            first_episode=first_episode + at,
            seed=seed,
        )

    grown = grow(
        tree,
        arena,
        nodes=int(GROWN * max_nodes),
        budget=Budget(GROWING * budget.steps, GROWING * budget.seconds),
        first_episode=first_episode,
        seed=seed,
    )
    if grown is tree:
        return tree
    larger = polished(grown, POLISHING_FROM)
    smaller = chain(larger, arena, smallest=max_nodes, first_episode=first_episode + SHRINKING_FROM)[-1].tree
    better = polished(smaller, FINISHING_FROM)
    rivals = list(dict.fromkeys([tree, smaller, better]))
    start = first_episode + JUDGING_FROM
    judged = arena.play(rivals, range(start, start + 4 * effort_of(arena).last)).returns
    return rivals[int(judged.mean(axis=1, dtype=np.float64).argmax())]
