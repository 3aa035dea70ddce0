"""Growing by return: a tree gets more questions, those that earn it most.

The way back from `sympol.search.prune_by_return`. Where a tree is small and its numbers are as good as they
can be, what it
asks is what limits it. In each step

1. random questions with an answer of their own are drawn (`sympol.search.insertions`) and race
(`sympol.search.successive_halving`);
2. the best few of those that earn anything are planted: all, or two, or one, or none, whichever earns most in other
   episodes.

Most questions cost something, few earn something, and which those are is seen through much luck: so what was planted
need not be good. Pruned by return afterwards, the tree keeps what it can least do without.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from ..trees import DecisionTree
from .evaluators.base import Arena
from .evolve import Budget
from .insertions import Sprout, grown, sprouts
from .prune_by_return import Effort
from .scores import Scores
from .successive_halving import race

COMPILED = Effort(candidates=128, first=32, last=1024, watched=64)
"""Where an arena plays millions of steps a second."""
NATIVE = Effort(candidates=128, first=16, last=512, watched=64)
"""Where it plays a hundred thousand."""
HOSTED = Effort(candidates=32, first=8, last=64, watched=32)
"""Where the host steps the environment."""
PLANTED = (4, 2, 1)
"""Of the best, at once."""
PATIENCE = 2
"""Steps in a row that find nothing, after which it is given up."""


def grow(
    tree: DecisionTree,
    arena: Arena,
    *,
    nodes: int,
    budget: Budget,
    first_episode: int = 0,
    seed: int = 0,
    effort: Effort | None = None,
) -> DecisionTree:
    """The tree with more questions, as long as they are found to earn something.

    Args:
        tree: of any size; with so many ``nodes`` it stays as it is.
        arena: where it plays.
        nodes: that it shall have, a few more at most.
        budget: how long to search: it ends with the step that spends it.
        first_episode: episodes from this number on are played, others in each step.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.
        effort: how much is played; by default by the kind of arena.

    Raises:
        ValueError: a tree for other features or actions.
    """
    rng, at, missed = np.random.default_rng(seed), first_episode, 0
    effort = effort or {"jax": COMPILED, "native": NATIVE}.get(arena.spec.backend, HOSTED)
    began, before = time.perf_counter(), arena.steps
    while tree.n_nodes < nodes and missed < PATIENCE:
        if arena.steps - before >= budget.steps or time.perf_counter() - began >= budget.seconds:
            break
        drawn = sprouts(tree, arena.observe(tree, range(at, at + effort.watched)), effort.candidates, rng)
        others = [grown(tree, [sprout]) for sprout in drawn]
        scores, first, last = Scores(arena, at), effort.first, effort.last
        raced = race(scores, tree, others, keep=max(PLANTED), first=first, last=last)
        found = tree
        if best := _apart([drawn[i] for loss, i in raced if loss < 0]):
            several = [grown(tree, best[:number]) for number in PLANTED]
            judged = arena.play_changed(tree, several, range(at + last, at + 2 * last)).returns
            found = [tree, *several][int(judged.mean(axis=1, dtype=np.float64).argmax())]
        missed = missed + 1 if found is tree else 0
        tree, at = found, at + 2 * last
    return tree


def _apart(some: Sequence[Sprout]) -> list[Sprout]:
    """Those that a tree can have together, the first of them first."""
    found: list[Sprout] = []
    for sprout in some:
        if all(sprout.is_apart_from(other) for other in found):
            found.append(sprout)
    return found
