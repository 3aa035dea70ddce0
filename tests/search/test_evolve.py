"""Evolution: what it keeps, and that it finds what is known to be best."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from sympol.envs.registry import resolve
from sympol.search.budget import Budget
from sympol.search.evaluators.base import Evaluator, Returns
from sympol.search.evolve import ELITES, Archive, Entry, archive_sizes, evolve
from sympol.search.mutations import Leaf, Split, num_nodes
from sympol.trees import DecisionTree

SPEC = resolve("CartPole-v1")
LEAF = DecisionTree.from_complete(
    np.zeros(0, int), np.zeros(0), np.zeros((1, 2)), actions=SPEC.actions, **SPEC.features.metadata()
)


class Told(Evaluator):
    """Earns the share of observations in which it does what is right, plus luck that an episode has for all."""

    TRUTH = staticmethod(lambda x: ((x[:, 0] > 0.3) & (x[:, 2] <= 0.1)) | (x[:, 3] > 1.5))

    @functools.cache  # noqa: B019  (few episodes, few evaluators)
    def _seen(self, number):
        rng = np.random.default_rng([self.seed, number, self.purpose == "refine"])
        x = rng.normal(size=(64, 4)).astype(np.float32)
        return x, rng.normal(), self.TRUTH(x)

    def _play(self, trees, episodes):
        x, luck, right = zip(*map(self._seen, episodes), strict=True)
        x, right = np.concatenate(x), np.concatenate(right)
        hits = np.stack([tree.predict(x) == right for tree in trees]).reshape(len(trees), len(episodes), 64)
        returns = hits.mean(axis=2) + luck
        return Returns(returns.astype(np.float32), np.full(returns.shape, 64, np.int32))

    def _observe(self, tree, episodes):
        return np.concatenate([self._seen(number)[0] for number in episodes])


def chain(n):
    node = Leaf((1.0, 0.0))
    for i in range(n):
        node = Split(0, float(i), node, Leaf((0.0, 1.0)))
    return node


@pytest.mark.parametrize(("max_nodes", "sizes"), [(1, (1,)), (3, (1, 3)), (7, (1, 3, 5, 7))])
def test_small_sizes_are_all_told_apart(max_nodes, sizes):
    assert archive_sizes(max_nodes) == sizes


def test_large_sizes_are_told_apart_coarsely_and_odd_and_up_to_the_limit():
    sizes = archive_sizes(129)
    assert sizes[:17] == (*range(1, 32, 2), 35)
    assert sizes[-1] == 129
    assert all(size % 2 for size in sizes)
    assert list(sizes) == sorted(set(sizes))


def test_an_archive_keeps_the_best_few_of_each_size():
    archive = Archive(archive_sizes(9))
    means = np.random.default_rng(0).permutation(10)
    entries = [
        Entry(Split(0, float(mean), Leaf((1.0, 0.0)), Leaf((0.0, 1.0))), np.full(4, mean)) for mean in means
    ]
    archive.insert(entries)
    assert [entry.mean for entry in archive.entries[3]] == [9, 8, 7, 6][:ELITES]
    assert archive.to_beat(3, slice(0, 2)) == 6
    archive.insert([Entry(chain(3), np.full(4, 2.0)), Entry(chain(2), np.full(4, 99.0))])
    assert archive.front() == [3, 5]  # seven nodes earn less than five


def test_of_equals_the_new_ones_stay():
    archive = Archive(archive_sizes(3))
    nodes = [Split(0, float(i), Leaf((1.0, 0.0)), Leaf((0.0, 1.0))) for i in range(ELITES + 1)]
    archive.insert([Entry(node, np.ones(4)) for node in nodes[:-1]])
    archive.insert([Entry(nodes[-1], np.ones(4))])
    assert [entry.node for entry in archive.entries[3]] == nodes[:0:-1]
    better = Split(1, 0.0, Leaf((1.0, 0.0)), Leaf((0.0, 1.0)))
    archive.insert([Entry(better, np.full(4, 2.0))])
    archive.insert([Entry(nodes[0], np.ones(4))])
    assert [entry.node for entry in archive.entries[3]] == [better, nodes[0], *nodes[:2:-1]]


def test_it_finds_the_rule_that_is_right():
    evaluator = Told(SPEC, 0)
    found = evolve(evaluator, [LEAF], max_nodes=7, budget=Budget(steps=3_000_000), episodes=16, seed=1)
    fresh = Told(SPEC, 0, "validation")
    luck = np.array([fresh._seen(number)[1] for number in range(50)])
    best = max((fresh.play([tree], range(50)).returns[0] - luck).mean() for tree in found.trees)
    assert best > 0.97  # three questions are enough for all of it
    assert max(tree.n_nodes for tree in found.trees) <= 7


def test_with_a_budget_in_steps_the_same_seed_finds_the_same_trees():
    one, other, third = (
        evolve(Told(SPEC, 0), [LEAF], max_nodes=5, budget=Budget(steps=200_000), episodes=8, seed=seed).trees
        for seed in (3, 3, 4)
    )
    assert one == other
    assert one != third


def test_a_large_start_leads_to_small_trees_and_none_is_larger_than_asked():
    rng = np.random.default_rng(0)
    start = DecisionTree.from_complete(
        rng.integers(0, 4, 15), rng.normal(size=15), rng.normal(size=(16, 2)),
        actions=SPEC.actions, **SPEC.features.metadata(),
    )  # fmt: skip
    found = evolve(Told(SPEC, 0), [start], max_nodes=9, budget=Budget(steps=200_000), episodes=8)
    assert {tree.n_nodes for tree in found.trees} <= {1, 3, 5, 7, 9}
    assert found.best.keys() == {tree.n_nodes for tree in found.trees}


def test_progress_tells_steps_and_the_best_of_each_size():
    epochs = []
    evaluator = Told(SPEC, 0)
    last = evolve(
        evaluator, [LEAF], max_nodes=3, budget=Budget(steps=200_000), episodes=8, progress=epochs.append
    )
    assert [epoch.steps for epoch in epochs] == sorted(epoch.steps for epoch in epochs)
    assert last.steps == evaluator.steps >= 200_000
    assert num_nodes(Leaf((0.0, 1.0))) in epochs[0].best


def test_bad_input():
    with pytest.raises(ValueError, match="at least one tree to start from"):
        evolve(Told(SPEC, 0), [], max_nodes=5, budget=Budget())
    with pytest.raises(ValueError, match=r"odd and at least 1.*got 4"):
        evolve(Told(SPEC, 0), [LEAF], max_nodes=4, budget=Budget())
