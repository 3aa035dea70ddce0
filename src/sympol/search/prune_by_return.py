"""Pruning by return: a tree loses nodes, those first that it earns most of its return without.

Exact pruning (`DecisionTree.prune`) keeps every action. Pruning by return keeps what they bring. Step by step

1. what none of the observed episodes needs goes: sides that nobody visits, splits that change no action there;
2. else one cut is made (`sympol.search.prunings`), the one that costs least. All promising moves play a few
   episodes, the better half of them twice as many, and so on (`sympol.search.comparison`). While the tree is large,
   a step makes several moves at once.

What the step brings is then measured in other episodes, by which nothing was chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32

from ..trees import DecisionTree
from .comparison import ReturnCache, compare_trees, successive_halving
from .evaluators.base import Evaluator
from .prunings import PruneMove, apply_prunings, prune_moves

SINGLY = 31
"""Nodes from which on down there is one cut a step."""
TRIED = 3
"""Cuts that are tested one after the other, where none may cost anything."""


class PrunedTree(NamedTuple):
    """A tree on the way down, and what it earned in each of the episodes that nothing is chosen by."""

    tree: DecisionTree
    returns: Float32[np.ndarray, " episodes"]

    @property
    def mean(self) -> float:
        """The mean return."""
        return float(self.returns.mean(dtype=np.float64))


class Effort(NamedTuple):
    """The episodes and candidates of a step of pruning."""

    candidates: int
    """Cuts that play, at most; those that change least."""
    first: int
    """Episodes of each at first."""
    last: int
    """Episodes of the best."""
    watched: int
    """Episodes that are observed."""


COMPILED = Effort(candidates=64, first=32, last=512, watched=64)
"""Where an evaluator plays millions of steps a second."""
NATIVE = Effort(candidates=64, first=16, last=512, watched=64)
"""Where it plays a hundred thousand."""
HOSTED = Effort(candidates=24, first=16, last=64, watched=32)
"""Where the host steps the environment."""

Progress: TypeAlias = Callable[[PrunedTree], object]


def prune_by_return(
    tree: DecisionTree,
    evaluator: Evaluator,
    *,
    max_nodes: int | None = None,
    node_price: float = 0.0,
    observations: Float32[np.ndarray, "batch features"] | None = None,
    first_episode: int = 0,
    effort: Effort | None = None,
    progress: Progress | None = None,
) -> PrunedTree:
    """Prune a tree to the smallest part that earns as much, or to at most ``max_nodes``, whatever that costs.

    Args:
        tree: of any size; it loses nodes, and leaves where nodes went may get another answer.
        evaluator: where it plays.
        max_nodes: go on, even at a loss, until there are no more; and stop there, if nodes have no price.
        node_price: the return that a node must be worth: go on as long as less is lost for each node removed.
            At 0, and with no ``max_nodes``, go on as long as nothing is lost.
        observations: all there can be, where they are listed: then the tree acts on no others.
        first_episode: episodes from this number on are played, twice ``effort.last`` of them.
        effort: how much is played; by default by the kind of evaluator.
        progress: called with each tree on the way down.

    Returns:
        The pruned tree, and its returns in ``effort.last`` episodes by which nothing was chosen.

    Raises:
        ValueError: a size below 1 or even, a price below 0, or a tree for other features or actions.
    """
    check_limit(max_nodes, node_price)
    aim = 1 if max_nodes is None else max_nodes
    way = _Pruning(evaluator, effort or default_effort(evaluator), aim, observations, first_episode)
    now: PrunedTree = way.begin(tree)
    while True:
        if progress is not None:
            progress(now)
        if max_nodes is not None and now.tree.n_nodes > max_nodes:
            now = way.forced_step(now)
            continue
        may_go_on = max_nodes is None or node_price > 0
        found = way.free_step(now, node_price) if may_go_on else None
        if found is None:
            return now
        now = found


def prune_path(
    tree: DecisionTree,
    evaluator: Evaluator,
    *,
    smallest: int = 1,
    observations: Float32[np.ndarray, "batch features"] | None = None,
    first_episode: int = 0,
    effort: Effort | None = None,
    progress: Progress | None = None,
) -> list[PrunedTree]:
    """Prune a tree step by step, from exact pruning down to ``smallest`` nodes or one leaf.

    Args:
        tree: A tree of any size.
        evaluator: The evaluator that plays the trees.
        smallest: The number of nodes at which to stop, odd.
        observations: All observations there can be ``[batch, features]``, where they are listed.
        first_episode: The first episode that is played; twice ``effort.last`` are played from there on.
        effort: How much is played in a step; by default by the kind of evaluator.
        progress: Called with each tree on the way down.

    Returns:
        The trees, the largest first, each with its returns in ``effort.last`` episodes.

    Raises:
        ValueError: A size below 1 or even, or a tree for other features or actions.
    """
    check_limit(smallest, 0.0)
    way = _Pruning(evaluator, effort or default_effort(evaluator), smallest, observations, first_episode)
    found: list[PrunedTree] = []
    while not found or found[-1].tree.n_nodes > smallest:
        found.append(way.forced_step(found[-1]) if found else way.begin(tree))
        if progress is not None:
            progress(found[-1])
    return found


def default_effort(evaluator: Evaluator) -> Effort:
    """Return the default effort for an evaluator."""
    return {"jax": COMPILED, "native": NATIVE}.get(evaluator.spec.backend, HOSTED)


def check_limit(max_nodes: int | None, node_price: float) -> None:
    """Raise ValueError unless a tree can have so many nodes, and nodes such a price."""
    if max_nodes is not None and (max_nodes < 1 or max_nodes % 2 == 0):
        raise ValueError(f"max_nodes must be odd and at least 1, got {max_nodes}")
    if not 0 <= node_price < np.inf:
        raise ValueError(f"node_price must be a return, 0 or more, got {node_price}")


@dataclass
class _Pruning:
    """The way down."""

    evaluator: Evaluator
    effort: Effort
    aim: int
    observations: Float32[np.ndarray, "batch features"] | None
    first_episode: int
    search_returns: ReturnCache = field(init=False)
    """Returns by which moves are chosen."""
    judge: ReturnCache = field(init=False)
    """What they are then measured by."""

    def __post_init__(self) -> None:
        self.search_returns = ReturnCache(self.evaluator, self.first_episode)
        self.judge = ReturnCache(self.evaluator, self.first_episode + self.effort.last)

    def begin(self, tree: DecisionTree) -> PrunedTree:
        return self._judged(tree.prune(observations=self.observations))

    def forced_step(self, now: PrunedTree) -> PrunedTree:
        """What costs least, whatever that is."""
        seen = self._seen(now.tree)
        if (idle := self._idle(now, seen)) is not None:
            return idle
        batch = max(1, (now.tree.n_nodes - max(self.aim, SINGLY)) // 8)
        ranked = self._ranked(now.tree, prune_moves(now.tree, seen), batch)
        while batch > 1:
            some = ranked[:batch]
            together = apply_prunings(now.tree, [cut for _, cut in some])
            allowed = sum(max(0.0, loss) for loss, _ in some)
            if compare_trees(self.search_returns, now.tree, together, margin=allowed, **self._looks).holds:
                return self._judged(together)
            batch //= 2
        return self._judged(apply_prunings(now.tree, [ranked[0][1]]))

    def free_step(self, now: PrunedTree, node_price: float) -> PrunedTree | None:
        """What costs no more than the price of the nodes that go; None where everything does."""
        if now.tree.n_nodes == 1:
            return None
        seen = self._seen(now.tree)
        if (idle := self._idle(now, seen)) is not None:
            return idle
        found = prune_moves(now.tree, seen)
        for _, cut in self._ranked(now.tree, found, TRIED, node_price)[:TRIED]:
            new = self._judged(apply_prunings(now.tree, [cut]))
            margin = node_price * (now.tree.n_nodes - new.tree.n_nodes)
            how = {**self._looks, "candidates": len(found)}
            if compare_trees(self.judge, now.tree, new.tree, margin=margin, **how).holds:
                return new
        return None

    @property
    def _looks(self) -> dict[str, int]:
        return {"first": self.effort.first, "last": self.effort.last}

    def _seen(self, tree: DecisionTree) -> Float32[np.ndarray, "steps features"]:
        return self.evaluator.observe(
            tree, range(self.first_episode, self.first_episode + self.effort.watched)
        )

    def _idle(self, now: PrunedTree, seen: Float32[np.ndarray, "steps features"]) -> PrunedTree | None:
        """Without what acts no otherwise in the episodes observed; None if nothing is, or others need it."""
        smaller = now.tree.prune(observations=seen)
        if smaller.n_nodes == now.tree.n_nodes:
            return None
        new = self._judged(smaller)
        return new if compare_trees(self.judge, now.tree, new.tree, **self._looks).holds else None

    def _ranked(
        self, tree: DecisionTree, some: Sequence[PruneMove], keep: int, node_price: float = 0.0
    ) -> list[tuple[float, PruneMove]]:
        """Rank the moves that cost least, with their losses, after halving their number until ``keep`` are left."""
        some = some[: self.effort.candidates]

        def key(loss: float, i: int) -> tuple[float, int]:
            return loss - node_price * some[i].removed, -some[i].removed

        others = [apply_prunings(tree, [cut]) for cut in some]
        found = successive_halving(self.search_returns, tree, others, keep=keep, **self._looks, key=key)
        return [(loss, some[i]) for loss, i in found]

    def _judged(self, tree: DecisionTree) -> PrunedTree:
        """Exactly pruned, with its returns."""
        tree = tree.prune(observations=self.observations)
        return PrunedTree(tree, self.judge.of(tree, self.effort.last))
