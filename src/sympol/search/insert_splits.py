"""Insert splits by return: a tree gets the additional splits that earn it most.

This is the inverse of `sympol.search.prune_by_return`. Where a tree is small and its thresholds are as good as
they can be, its splits are what limits it. In each step of `insert_splits`

1. random splits with a new leaf are drawn (`sample_insertions`) and ranked by successive halving;
2. the best few that gain anything are inserted: four, two, one or none, whichever earns most in other episodes.

An insertion above a leaf splits it. Above an inner node it takes a part of the observations away from
everything below, which many leaves would otherwise have to split off together. Few insertions gain anything,
and which ones do is blurred by chance, so an inserted split need not be good. Pruned by return afterwards, the
tree keeps what it can least do without.

`resplit` exchanges splits at a given size: the tree grows by a quarter, is fine-tuned, pruned back and
fine-tuned again. Fine-tuning moves thresholds only and pruning only removes; together with insertion they
change which features are tested.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from ..seeds import EpisodeBlock, SeedStream
from ..trees import DecisionTree
from ..trees.edit import graft_all, leaf_tree, split_tree, subtree, subtree_end
from .budget import Budget, Meter
from .comparison import ReturnCache, successive_halving
from .evaluators.base import Evaluator
from .finetune_thresholds import finetune_thresholds
from .mutations import Leaf, Mutator
from .prune_by_return import Effort, default_effort, prune_path

DRAW_FACTOR = 4
"""The most draws, as a multiple of the number wanted: some are alike or change nothing."""


class SplitInsertion(NamedTuple):
    """The insertion of a split above a node."""

    node: int
    end: int
    """The first node after the node's subtree."""
    part: DecisionTree
    """The tree that takes the place of the node's subtree."""

    def is_disjoint_from(self, other: SplitInsertion) -> bool:
        """Return True where neither node is above the other, so that a tree can have both."""
        return self.end <= other.node or other.end <= self.node


def sample_insertions(
    tree: DecisionTree,
    observations: Float32[np.ndarray, "steps features"],
    number: int,
    rng: np.random.Generator,
) -> list[SplitInsertion]:
    """Sample distinct split insertions.

    Each node that saw two different observations is as likely as any other, and so is each feature that differs
    there. The threshold lies between two values that were seen there.

    Args:
        tree: The tree.
        observations: The observations ``[steps, features]`` that it acts on.
        number: How many to sample at most.
        rng: The generator that draws.

    Returns:
        The insertions; fewer where few differ, and none where all observations are the same.
    """
    leaf = np.atleast_1d(tree.apply(observations))
    ends = [subtree_end(tree, node) for node in range(tree.n_nodes)]
    rows = [np.flatnonzero((leaf >= node) & (leaf < end)) for node, end in enumerate(ends)]
    nodes = [node for node, here in enumerate(rows) if (observations[here] != observations[here[:1]]).any()]
    if not nodes:
        return []
    mutator = Mutator.for_observations(tree.actions, observations)
    sampled: dict[tuple[int, DecisionTree], SplitInsertion] = {}
    for _ in range(DRAW_FACTOR * number):
        if len(sampled) == number:
            break
        node = nodes[int(rng.integers(len(nodes)))]
        here = rows[node]
        x, acted = observations[here], int(leaf[here[int(rng.integers(len(here)))]])
        value = mutator.mutated_leaf(Leaf(tuple(tree.leaf_outputs[acted].tolist())), rng).value
        other = leaf_tree(tree, np.array(value, np.float32))
        feature = int(rng.choice(np.flatnonzero((x != x[0]).any(axis=0))))
        values = np.unique(x[:, feature])
        at = int(rng.integers(len(values) - 1))
        sides = [subtree(tree, node), other]
        if rng.random() < 0.5:
            sides.reverse()
        threshold = values[at : at + 2].mean(dtype=np.float64)
        insertion = SplitInsertion(node, ends[node], split_tree(feature, float(threshold), *sides))
        if not (tree.is_leaf[node] and _acts_as(tree, node, other)):
            sampled.setdefault((node, insertion.part), insertion)
    return list(sampled.values())


def apply_insertions(tree: DecisionTree, insertions: Iterable[SplitInsertion]) -> DecisionTree:
    """Apply several insertions.

    Args:
        tree: The tree.
        insertions: Insertions into it, none of whose nodes is above another's.

    Returns:
        A tree of two more nodes for each of them.
    """
    return graft_all(tree, ((insertion.node, insertion.part) for insertion in insertions))


def _acts_as(tree: DecisionTree, leaf: int, other: DecisionTree) -> bool:
    return bool((tree.leaf_actions[leaf] == other.leaf_actions).all())


COMPILED = Effort(candidates=128, first=32, last=1024, watched=64)
"""Where an evaluator plays millions of steps a second."""
NATIVE = Effort(candidates=128, first=16, last=512, watched=64)
"""Where it plays a hundred thousand."""
HOSTED = Effort(candidates=32, first=8, last=64, watched=32)
"""Where the host steps the environment."""
AT_ONCE = (4, 2, 1)
"""How many of the best insertions are tried together."""
PATIENCE = 2
"""Steps in a row without a gain, after which the search ends."""


def insert_splits(
    tree: DecisionTree,
    evaluator: Evaluator,
    *,
    nodes: int,
    budget: Budget,
    first_episode: int = 0,
    seed: int = 0,
    effort: Effort | None = None,
) -> DecisionTree:
    """Insert splits into a tree as long as they increase its return.

    Args:
        tree: A tree of any size; one of at least ``nodes`` nodes stays as it is.
        evaluator: The evaluator that plays the trees.
        nodes: The number of nodes that it shall have; it may get a few more.
        budget: How long to search; it ends with the step that spends it.
        first_episode: The first episode that is played; each step plays others.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.
        effort: How much is played in a step; by default by the kind of evaluator.

    Returns:
        The larger tree; the tree itself where no insertion gains anything.

    Raises:
        ValueError: A tree for other features or actions.
    """
    rng, at, missed = SeedStream(seed).generator(), first_episode, 0
    effort = effort or {"jax": COMPILED, "native": NATIVE}.get(evaluator.spec.backend, HOSTED)
    meter = Meter(evaluator)
    while tree.n_nodes < nodes and missed < PATIENCE and meter.has(budget):
        drawn = sample_insertions(
            tree, evaluator.observe(tree, range(at, at + effort.watched)), effort.candidates, rng
        )
        others = [apply_insertions(tree, [insertion]) for insertion in drawn]
        scores, first, last = ReturnCache(evaluator, at), effort.first, effort.last
        ranked = successive_halving(scores, tree, others, keep=max(AT_ONCE), first=first, last=last)
        better = tree
        if best := _disjoint([drawn[i] for loss, i in ranked if loss < 0]):
            several = [apply_insertions(tree, best[:number]) for number in AT_ONCE]
            judged = evaluator.play_variants(tree, several, range(at + last, at + 2 * last)).returns
            better = [tree, *several][int(judged.mean(axis=1, dtype=np.float64).argmax())]
        missed = missed + 1 if better is tree else 0
        tree, at = better, at + 2 * last
    return tree


def _disjoint(insertions: Sequence[SplitInsertion]) -> list[SplitInsertion]:
    """Return those that a tree can have together; earlier ones come first."""
    chosen: list[SplitInsertion] = []
    for insertion in insertions:
        if all(insertion.is_disjoint_from(other) for other in chosen):
            chosen.append(insertion)
    return chosen


ENLARGED = 1.25
"""The size to which splits are inserted, as a multiple of the limit."""
INSERTING = 0.5
"""The part of a budget after which no more splits are inserted."""
FINE_TUNING = 1 / 3
"""The budget of each fine-tuning, as a part of what was spent before it."""
EPISODES = 1 << 20
"""The number of episodes that are set aside for one re-splitting."""


def resplit(
    tree: DecisionTree,
    evaluator: Evaluator,
    *,
    max_nodes: int,
    budget: Budget,
    episodes: int = 32,
    first_episode: int = 0,
    seed: int = 0,
) -> DecisionTree:
    """Exchange splits of a tree within a limit of nodes, so that it earns more.

    Args:
        tree: A tree whose thresholds are fine-tuned already.
        evaluator: The evaluator that plays the trees.
        max_nodes: The limit of nodes, which the tree is within already.
        budget: How long to search; pruning may take longer.
        episodes: Episodes of a generation of fine-tuning.
        first_episode: The first episode that is played; `EPISODES` are set aside from there on.
        seed: With a budget in steps the same seed gives the same tree, bit for bit.

    Returns:
        A tree of at most ``max_nodes`` nodes that earns more; the tree itself where none is found.

    Raises:
        ImportError: pycma is not installed.
        ValueError: A tree for other features or actions.
    """
    meter = Meter(evaluator)
    parts = [
        EpisodeBlock(first_episode, EPISODES).part(i, 8) for i in range(8)
    ]  # inserting takes the first two

    def fine_tuned(one: DecisionTree, block: EpisodeBlock) -> DecisionTree:
        """Fine-tune for a part of what was spent so far, within what is left."""
        left = meter.left(budget)
        return finetune_thresholds(
            [one],
            evaluator,
            budget=Budget(min(FINE_TUNING * meter.steps, left.steps), left.seconds),
            episodes=episodes,
            first_episode=block.start,
            seed=seed,
        )

    enlarged = insert_splits(
        tree,
        evaluator,
        nodes=int(ENLARGED * max_nodes),
        budget=budget.part(INSERTING),
        first_episode=first_episode,
        seed=seed,
    )
    if enlarged is tree:
        return tree
    larger = fine_tuned(enlarged, parts[4])
    smaller = prune_path(larger, evaluator, smallest=max_nodes, first_episode=parts[2].start)[-1].tree
    better = fine_tuned(smaller, parts[5])
    finalists = list(dict.fromkeys([tree, smaller, better]))
    start = parts[3].start
    judged = evaluator.play(finalists, range(start, start + 4 * default_effort(evaluator).last)).returns
    return finalists[int(judged.mean(axis=1, dtype=np.float64).argmax())]
