"""The evaluator: what a plain loop brings, for every tree and episode, whatever else is played.

The loop is the oracle: it asks `DecisionTree.predict` for one observation at a time and steps one environment.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sympol.envs.errors import EnvironmentFailure
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.play import PURPOSE_TAGS, episode_seed, play
from sympol.search.evaluators import Evaluator, Returns, make_evaluator
from sympol.search.evaluators import jax as batched
from sympol.search.evaluators import jax as compiled
from sympol.search.evaluators.packed_trees import MAX_LEAVES
from sympol.trees import BoxActions, DecisionTree, DiscreteActions

from .loops import SEED, assert_same, grown, jax_loop, looped, of_parity, spec_of
from .worlds import Broken, Endless, NoisyWalk


@pytest.mark.parametrize(
    ("env", "exact", "episodes"),
    [
        pytest.param("CartPole-v1", True, range(3, 6), id="discrete"),
        # a step that is compiled alone may round otherwise
        pytest.param("Pendulum-v1", False, range(2), id="continuous"),
        pytest.param("MiniGrid-LavaGapS5-v0", True, range(2), id="groups"),
        pytest.param(NoisyWalk(), False, range(3, 6), id="several choices, noise, no time limit"),
    ],
)
def test_every_tree_gets_what_a_plain_loop_gets(env, exact, episodes):
    spec = resolve(env)
    evaluator = make_evaluator(spec, SEED)
    crowd = [grown(spec, 1 + seed % MAX_LEAVES, seed) for seed in range(160)]
    in_crowd = evaluator.play(crowd, episodes)
    # of random trees most play alike: look at some that do not
    unlike = np.unique(in_crowd.lengths * 1000 + in_crowd.returns, axis=0, return_index=True)[1]
    some = unlike[:: max(1, len(unlike) // 5)]
    trees = [crowd[i] for i in some] + [grown(spec, 45, 9)]
    theirs = looped(spec, trees, episodes)
    by_links = evaluator.play(trees, episodes)
    assert_same(by_links, theirs, exact=exact)
    np.testing.assert_array_equal(by_links.returns[:-1], in_crowd.returns[some])
    np.testing.assert_array_equal(by_links.lengths[:-1], in_crowd.lengths[some])
    assert evaluator.steps == in_crowd.lengths.sum() + by_links.lengths.sum()
    assert len(unlike) > 4, "all trees play alike: this tests nothing"


def compiled_case() -> tuple[Evaluator, list[DecisionTree]]:
    spec = spec_of("CartPole-v1")
    return make_evaluator(spec, SEED), [grown(spec, 2 + n, n) for n in range(12)]


def host_case() -> tuple[Evaluator, list[DecisionTree]]:
    spec = resolve("CartPole-v1", backend="host")
    return make_evaluator(spec, SEED), [grown(spec, 2 + n, n) for n in range(12)]


def native_case() -> tuple[Evaluator, list[DecisionTree]]:
    spec = resolve("LunarLander-v3", backend="native")
    return make_evaluator(spec, SEED), [grown(spec, 2 + n, n) for n in range(6)]


EVERYWHERE = pytest.mark.parametrize(
    "case", [compiled_case, host_case, native_case], ids=lambda c: c.__name__
)


@EVERYWHERE
def test_an_episode_is_the_same_whatever_else_is_in_the_call(case):
    evaluator, trees = case()
    all_of_them = evaluator.play(trees, range(40, 60))
    for some, episodes in (
        (trees[::-1], range(40, 60)),
        (trees[2:4], range(45, 47)),
        (trees[:1] * 3, range(59, 60)),
    ):
        again = evaluator.play(some, episodes)
        where = [trees.index(tree) for tree in some]
        columns = slice(episodes.start - 40, episodes.stop - 40)
        np.testing.assert_array_equal(again.returns, all_of_them.returns[where, columns])
        np.testing.assert_array_equal(again.lengths, all_of_them.lengths[where, columns])
    assert len(np.unique(all_of_them.returns)) > 20


@EVERYWHERE
def test_observations_are_those_that_the_tree_acts_on(case):
    evaluator, trees = case()
    # 16 are watched at once; 21 are one and a bit
    lengths = evaluator.play(trees[3:4], range(5, 26)).lengths[0]
    before = evaluator.steps
    seen = evaluator.observe(trees[3], range(5, 26))
    assert evaluator.steps - before == len(seen) == lengths.sum()
    assert seen.dtype == np.float32
    ends = np.cumsum(lengths)
    for episode in (0, 15, 16, 20):
        alone = evaluator.observe(trees[3], range(5 + episode, 6 + episode))
        np.testing.assert_array_equal(alone, seen[ends[episode] - lengths[episode] : ends[episode]])


@EVERYWHERE
def test_episodes_to_search_with_are_not_those_to_choose_with(case):
    evaluator, trees = case()
    others = [make_evaluator(evaluator.spec, SEED, "validation"), make_evaluator(evaluator.spec, SEED + 1)]
    first = [each.observe(trees[0], range(4)) for each in (evaluator, *others)]
    starts = [{row.tobytes() for row in rows} for rows in first]
    assert not starts[0] & starts[1]
    assert not starts[0] & starts[2]
    again = type(evaluator)(evaluator.spec, SEED).observe(trees[0], range(4))
    np.testing.assert_array_equal(again, first[0])


def test_what_a_compiled_arena_shows_is_what_the_loop_sees():
    evaluator, trees = compiled_case()
    seen = [row for episode in range(3) for row in jax_loop(evaluator.spec, trees[5], episode)[2]]
    np.testing.assert_array_equal(evaluator.observe(trees[5], range(3)), np.stack(seen))


def test_more_than_one_call_holds_is_done_in_several(monkeypatch):
    evaluator, trees = compiled_case()
    whole = evaluator.play(trees, range(2, 9))
    monkeypatch.setattr(compiled, "MAX_TREES", 5)
    by_trees = evaluator.play(trees, range(2, 9))
    monkeypatch.setattr(compiled, "MAX_JOBS", 3)
    by_episodes = evaluator.play(trees[:4], range(2, 9))
    assert_same(by_trees, whole)
    assert_same(by_episodes, Returns(whole.returns[:4], whole.lengths[:4]))


def test_more_episodes_than_a_call_holds():
    evaluator, trees = compiled_case()
    worst = [min(trees, key=lambda tree: evaluator.play([tree], range(8)).lengths.mean())]
    played = evaluator.play(worst, range(batched.MAX_JOBS + 40))
    assert played.lengths.shape == (1, batched.MAX_JOBS + 40)
    assert played.lengths.min() >= 1
    for last in (
        range(batched.MAX_JOBS - 2, batched.MAX_JOBS + 3),
        range(batched.MAX_JOBS + 35, batched.MAX_JOBS + 40),
    ):
        np.testing.assert_array_equal(
            evaluator.play(worst, last).lengths, played.lengths[:, last.start : last.stop]
        )


def test_an_environment_without_a_clock_gets_one(monkeypatch):
    monkeypatch.setattr(batched, "MAX_EPISODE_STEPS", 37)
    batched.compile_play.cache_clear()
    batched.compile_observe.cache_clear()
    spec = resolve(Endless())
    right, wrong = (of_parity(spec, swapped) for swapped in (False, True))
    evaluator = make_evaluator(spec, SEED)
    played = evaluator.play([right, wrong], range(3))
    np.testing.assert_array_equal(played.lengths, np.full((2, 3), 37))
    np.testing.assert_array_equal(played.returns, [[37] * 3, [0] * 3])
    np.testing.assert_array_equal(evaluator.observe(right, range(1))[:, 0], np.arange(37) % 2)
    batched.compile_play.cache_clear()
    batched.compile_observe.cache_clear()


def test_returns_are_distributed_as_on_gymnasium():
    spec = spec_of("CartPole-v1")
    balances = _leaning(spec)
    ours = make_evaluator(spec, SEED).play([balances], range(400)).returns[0]
    theirs = play(balances, spec, 200, seed=SEED, purpose="refine").returns
    error = np.sqrt(ours.var() / len(ours) + theirs.var() / len(theirs))
    assert abs(ours.mean() - theirs.mean()) < 4 * error
    assert 30 < theirs.mean() < 60


def _leaning(spec: EnvSpec) -> DecisionTree:
    """Pushes to the side that the pole leans to: 42 steps, a few more or less."""
    return DecisionTree.from_complete(
        np.array([2]), np.array([0.0]), np.eye(2), actions=spec.actions, feature_names=spec.features.names
    )


def test_seeds_are_never_a_test_s():
    tests = {episode_seed(SEED, episode) for episode in range(1000)}
    for purpose in ("refine", "validation"):
        seeds = {episode_seed(SEED, episode, purpose) for episode in range(1000)}
        assert not seeds & tests
        assert len(seeds) == 1000
    assert len(set(PURPOSE_TAGS.values())) == len(PURPOSE_TAGS)


@EVERYWHERE
def test_what_cannot_be_played_is_refused(case):
    evaluator, trees = case()
    with pytest.raises(ValueError, match="0 trees and 3 episodes"):
        evaluator.play([], range(3))
    with pytest.raises(ValueError, match="1 trees and 0 episodes"):
        evaluator.play(trees[:1], range(3, 3))
    for episodes in (range(0, 9, 2), range(-3, 4), range(2**31, 2**31 + 2)):
        with pytest.raises(ValueError, match="consecutive numbers between 0 and 2147483647"):
            evaluator.play(trees[:1], episodes)
    other = grown(spec_of("Pendulum-v1"), 3, 0)
    with pytest.raises(ValueError, match="a tree of 3 features cannot play"):
        evaluator.observe(other, range(3))
    assert evaluator.steps == 0


def test_a_tree_for_other_actions_is_refused():
    spec = spec_of("CartPole-v1")
    evaluator, names = make_evaluator(spec, SEED), spec.features.names
    others = [DiscreteActions(2, start=1), BoxActions((-1, -1), (1, 1), (2,)), DiscreteActions(3)]
    for actions in others:
        tree = DecisionTree.from_complete(
            np.array([2]), np.array([0.0]), np.eye(2, actions.n_outputs), actions=actions, feature_names=names
        )
        with pytest.raises(ValueError, match="cannot play CartPole-v1"):
            evaluator.play([tree], range(2))
    named = DecisionTree.from_complete(
        np.array([2]),
        np.array([0.0]),
        np.eye(2),
        actions=DiscreteActions(2, ("links", "rechts")),
        feature_names=names,
    )
    assert evaluator.play([named], range(1)).returns.shape == (1, 1)


def test_a_seed_or_purpose_that_there_is_not():
    spec: Any = spec_of("CartPole-v1")
    for seed in (-1, 2**32):
        with pytest.raises(ValueError, match="seed must be between 0"):
            make_evaluator(spec, seed)
    purpose: Any = "test"
    with pytest.raises(ValueError, match="refine, validation, got 'test'"):
        make_evaluator(spec, 0, purpose)


def test_rewards_that_are_no_numbers():
    spec = resolve(Broken())
    with pytest.raises(EnvironmentFailure, match=r"not finite in float32: tree 0 in episode 4 got inf"):
        make_evaluator(spec, SEED).play([of_parity(spec, False)], range(4, 6))
