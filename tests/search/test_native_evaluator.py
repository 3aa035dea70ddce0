"""The evaluator in machine code: what copies that are stepped one by one bring."""

from __future__ import annotations

import numpy as np
import pytest

from sympol.envs.lunar_lander.batch import Copies, engine_power
from sympol.envs.registry import resolve
from sympol.play import episode_seed
from sympol.search.evaluators import make_evaluator
from sympol.search.evaluators.native import NativeEvaluator
from sympol.search.insert_splits import apply_insertions as planted
from sympol.search.insert_splits import sample_insertions

from .loops import SEED, grown


@pytest.mark.parametrize("name", ["LunarLander-v3", "LunarLanderContinuous-v3"])
def test_whole_episodes_are_those_of_single_steps(name):
    spec = resolve(name, backend="native")
    trees, episodes, every = [grown(spec, n, n) for n in (3, 20)], range(70, 75), np.ones(1, bool)
    evaluator = make_evaluator(spec, SEED)
    assert isinstance(evaluator, NativeEvaluator)
    played = evaluator.play(trees, episodes)
    for i, tree in enumerate(trees):
        for j, episode in enumerate(episodes):
            copies = Copies(np.array([episode_seed(SEED, episode, "refine")], np.uint64))
            seen, total, over = [], 0.0, False
            while not over:
                seen.append(copies.observation[0].copy())
                power = engine_power(np.asarray(tree.predict(seen[-1]))[None])
                moved = copies.step(power, every, np.zeros(1, np.uint64))
                total += float(moved.reward[0])
                over = bool(moved.terminated[0] or moved.truncated[0])
            assert played.lengths[i, j] == len(seen)
            assert played.returns[i, j] == np.float32(total)
            np.testing.assert_array_equal(
                evaluator.observe(tree, range(episode, episode + 1)), np.stack(seen)
            )


def test_threads_change_nothing(monkeypatch):
    spec = resolve("LunarLander-v3", backend="native")
    trees = [grown(spec, n, n) for n in (3, 20)]
    played = []
    for threads in ("1", "3"):
        monkeypatch.setenv("PJRT_NPROC", threads)
        played.append(make_evaluator(spec, SEED).play(trees, range(8)))
    for one, other in zip(*played, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", ["LunarLander-v3", "LunarLanderContinuous-v3"])
def test_what_trees_do_alike_is_simulated_once(name, monkeypatch):
    monkeypatch.setenv("PJRT_NPROC", "2")
    spec, episodes = resolve(name, backend="native"), range(90, 103)
    tree = grown(spec, 20, 20)
    seen = make_evaluator(spec, SEED).observe(tree, episodes)
    rng = np.random.default_rng(0)
    others = [planted(tree, [insertion]) for insertion in sample_insertions(tree, seen, 12, rng)]
    others += [grown(spec, 3, 3), tree]
    evaluator, whole = make_evaluator(spec, SEED), make_evaluator(spec, SEED)
    played, expected = evaluator.play_variants(tree, others, episodes), whole.play([tree, *others], episodes)
    for ours, theirs in zip(played, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    # of each whatever comes after it first acted otherwise, and all of the first
    alone, at = int(expected.lengths[0].sum()), np.cumsum([0, *expected.lengths[0]])
    acted = tree.predict(seen)
    for other, lengths in zip(others, expected.lengths[1:], strict=True):
        differs = (other.predict(seen) != acted).reshape(len(seen), -1).any(axis=1)
        for i, length in enumerate(lengths.tolist()):
            where = np.flatnonzero(differs[at[i] : at[i + 1]])
            alone += length - int(where[0]) if len(where) else 0
    assert evaluator.steps == alone < whole.steps
