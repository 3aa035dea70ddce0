"""Pruning by return: a tree loses the nodes that contribute least to its return.

Exact pruning (`DecisionTree.prune`) preserves every action; pruning by return preserves their return. Each step

1. removes what none of the observed episodes needs: sides that are never visited, splits that change no action there;
2. or else makes the prune move that costs least (`sympol.search.prunings`). All promising moves play a few episodes,
   the better half of them twice as many, and so on (`sympol.search.comparison`). While the tree is large, a step makes
   several moves at once.

The result of the step is then measured in other episodes, by which nothing was chosen.
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
"""The largest number of nodes at which a step makes a single move."""
TRIED = 3
"""Moves that are tested one after the other where none may cost anything."""


class PrunedTree(NamedTuple):
    """A pruned tree and its returns in episodes by which nothing is chosen."""

    tree: DecisionTree
    returns: Float32[np.ndarray, " episodes"]

    @property
    def mean(self) -> float:
        """The mean return."""
        return float(self.returns.mean(dtype=np.float64))


class Effort(NamedTuple):
    """The episodes and candidates of a step of pruning."""

    candidates: int
    """The largest number of moves that play: those that change least."""
    first: int
    """Episodes that each plays at first."""
    last: int
    """Episodes that the best play."""
    watched: int
    """Episodes that are observed."""


COMPILED = Effort(candidates=64, first=32, last=512, watched=64)
"""The effort where an evaluator plays millions of steps a second."""
NATIVE = Effort(candidates=64, first=16, last=512, watched=64)
"""The effort where it plays a hundred thousand."""
HOSTED = Effort(candidates=24, first=16, last=64, watched=32)
"""The effort where the host steps the environment."""

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
    """Prune a tree to the smallest one that earns as much, or to a limit of nodes at any cost.

    Args:
        tree: A tree of any size. It loses nodes, and leaves where nodes were removed may get another action.
        evaluator: The evaluator that plays the trees.
        max_nodes: Prune to at most so many nodes, even at a loss; and no further, if nodes have no price.
        node_price: The return that a node must be worth: prune as long as less is lost for each node removed. At 0,
            and without ``max_nodes``, prune as long as nothing is lost.
        observations: All observations there can be ``[batch, features]``, where they are listed.
        first_episode: The first episode that is played; twice ``effort.last`` are played from there on.
        effort: How much is played in a step; by default by the kind of evaluator.
        progress: Called with the tree after each step.

    Returns:
        The pruned tree, and its returns in ``effort.last`` episodes by which nothing was chosen.

    Raises:
        ValueError: A size below 1 or even, a price below 0, or a tree for other features or actions.
    """
    check_limit(max_nodes, node_price)
    target = 1 if max_nodes is None else max_nodes
    pruning = _Pruning(evaluator, effort or default_effort(evaluator), target, observations, first_episode)
    now: PrunedTree = pruning.begin(tree)
    while True:
        if progress is not None:
            progress(now)
        if max_nodes is not None and now.tree.n_nodes > max_nodes:
            now = pruning.forced_step(now)
            continue
        may_continue = max_nodes is None or node_price > 0
        smaller = pruning.free_step(now, node_price) if may_continue else None
        if smaller is None:
            return now
        now = smaller


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
    """Prune a tree step by step, from exact pruning down to a number of nodes.

    Args:
        tree: A tree of any size.
        evaluator: The evaluator that plays the trees.
        smallest: The number of nodes at which to stop, odd.
        observations: All observations there can be ``[batch, features]``, where they are listed.
        first_episode: The first episode that is played; twice ``effort.last`` are played from there on.
        effort: How much is played in a step; by default by the kind of evaluator.
        progress: Called with the tree after each step.

    Returns:
        The trees, the largest first, each with its returns in ``effort.last`` episodes.

    Raises:
        ValueError: A size below 1 or even, or a tree for other features or actions.
    """
    check_limit(smallest, 0.0)
    pruning = _Pruning(evaluator, effort or default_effort(evaluator), smallest, observations, first_episode)
    trees: list[PrunedTree] = []
    while not trees or trees[-1].tree.n_nodes > smallest:
        trees.append(pruning.forced_step(trees[-1]) if trees else pruning.begin(tree))
        if progress is not None:
            progress(trees[-1])
    return trees


def default_effort(evaluator: Evaluator) -> Effort:
    """Return the default effort for the kind of an evaluator."""
    return {"jax": COMPILED, "native": NATIVE}.get(evaluator.spec.backend, HOSTED)


def check_limit(max_nodes: int | None, node_price: float) -> None:
    """Check a limit of size.

    Args:
        max_nodes: The largest number of nodes, or None.
        node_price: The return that a node must be worth.

    Raises:
        ValueError: A number of nodes that no tree has, or a price that is negative or not finite.
    """
    if max_nodes is not None and (max_nodes < 1 or max_nodes % 2 == 0):
        raise ValueError(f"max_nodes must be odd and at least 1, got {max_nodes}")
    if not 0 <= node_price < np.inf:
        raise ValueError(f"node_price must be a return, 0 or more, got {node_price}")


@dataclass
class _Pruning:
    """The settings and the returns of one pruning."""

    evaluator: Evaluator
    effort: Effort
    target: int
    observations: Float32[np.ndarray, "batch features"] | None
    first_episode: int
    search_returns: ReturnCache = field(init=False)
    """Returns by which moves are chosen."""
    measured_returns: ReturnCache = field(init=False)
    """Returns by which the results are then measured."""

    def __post_init__(self) -> None:
        self.search_returns = ReturnCache(self.evaluator, self.first_episode)
        self.measured_returns = ReturnCache(self.evaluator, self.first_episode + self.effort.last)

    def begin(self, tree: DecisionTree) -> PrunedTree:
        return self._measured(tree.prune(observations=self.observations))

    def forced_step(self, now: PrunedTree) -> PrunedTree:
        """Make the moves that cost least, at any cost."""
        seen = self._seen(now.tree)
        if (reduced := self._without_redundant(now, seen)) is not None:
            return reduced
        batch = max(1, (now.tree.n_nodes - max(self.target, SINGLY)) // 8)
        ranked = self._ranked(now.tree, prune_moves(now.tree, seen), batch)
        while batch > 1:
            best = ranked[:batch]
            together = apply_prunings(now.tree, [move for _, move in best])
            allowed = sum(max(0.0, loss) for loss, _ in best)
            if compare_trees(self.search_returns, now.tree, together, margin=allowed, **self._looks).holds:
                return self._measured(together)
            batch //= 2
        return self._measured(apply_prunings(now.tree, [ranked[0][1]]))

    def free_step(self, now: PrunedTree, node_price: float) -> PrunedTree | None:
        """Make the best move that costs no more than the nodes are worth; None where every move does."""
        if now.tree.n_nodes == 1:
            return None
        seen = self._seen(now.tree)
        if (reduced := self._without_redundant(now, seen)) is not None:
            return reduced
        moves = prune_moves(now.tree, seen)
        for _, move in self._ranked(now.tree, moves, TRIED, node_price)[:TRIED]:
            new = self._measured(apply_prunings(now.tree, [move]))
            margin = node_price * (now.tree.n_nodes - new.tree.n_nodes)
            how = {**self._looks, "candidates": len(moves)}
            if compare_trees(self.measured_returns, now.tree, new.tree, margin=margin, **how).holds:
                return new
        return None

    @property
    def _looks(self) -> dict[str, int]:
        return {"first": self.effort.first, "last": self.effort.last}

    def _seen(self, tree: DecisionTree) -> Float32[np.ndarray, "steps features"]:
        return self.evaluator.observe(
            tree, range(self.first_episode, self.first_episode + self.effort.watched)
        )

    def _without_redundant(
        self, now: PrunedTree, seen: Float32[np.ndarray, "steps features"]
    ) -> PrunedTree | None:
        """Remove what changes no action in the observed episodes; None if there is nothing, or others need it."""
        smaller = now.tree.prune(observations=seen)
        if smaller.n_nodes == now.tree.n_nodes:
            return None
        new = self._measured(smaller)
        return new if compare_trees(self.measured_returns, now.tree, new.tree, **self._looks).holds else None

    def _ranked(
        self, tree: DecisionTree, moves: Sequence[PruneMove], keep: int, node_price: float = 0.0
    ) -> list[tuple[float, PruneMove]]:
        """Rank the moves that cost least, with their losses, after halving their number until ``keep`` are left."""
        moves = moves[: self.effort.candidates]

        def key(loss: float, i: int) -> tuple[float, int]:
            return loss - node_price * moves[i].removed, -moves[i].removed

        others = [apply_prunings(tree, [move]) for move in moves]
        ranked = successive_halving(self.search_returns, tree, others, keep=keep, **self._looks, key=key)
        return [(loss, moves[i]) for loss, i in ranked]

    def _measured(self, tree: DecisionTree) -> PrunedTree:
        """Prune a tree exactly, and measure its returns."""
        tree = tree.prune(observations=self.observations)
        return PrunedTree(tree, self.measured_returns.of(tree, self.effort.last))
