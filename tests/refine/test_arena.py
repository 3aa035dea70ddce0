"""The arena: what a plain loop brings, for every tree and episode, whatever else is played.

The loop is the oracle: it asks `DecisionTree.predict` for one observation at a time and steps one environment.
"""

from __future__ import annotations

import functools
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.envs.host import EnvironmentFailure
from sympol.envs.pool import is_installed
from sympol.envs.registry import resolve
from sympol.envs.spec import EnvSpec
from sympol.play import WORDS, episode_seed, play
from sympol.refine import compiled, hosted, lanes
from sympol.refine.arena import Arena, Played, make_arena
from sympol.refine.masked import ALL, MAX_LEAVES, Masked
from sympol.trees import BoxActions, DecisionTree, DiscreteActions

from .worlds import Broken, Endless, NoisyWalk

SEED = 7


@functools.cache
def spec_of(name: str) -> EnvSpec:
    return resolve(name)


def grown(spec: EnvSpec, n_leaves: int, seed: int) -> DecisionTree:
    """A tree of any shape: splits are put at leaves drawn at random, thresholds among what there is to see."""
    rng, features = np.random.default_rng(seed), spec.features
    low, high = (np.clip(bound, -0.3, 0.3) for bound in (features.low, features.high))

    def node(n: int) -> list[Any]:
        if n == 1:
            return [{"value": rng.normal(size=spec.actions.n_outputs)}]
        left = int(rng.integers(1, n))
        feature = int(rng.integers(len(low)))
        one_hot = low[feature] == 0
        threshold = 0.5 if one_hot else rng.choice([0.0, *rng.uniform(low[feature], high[feature], 3)])
        return [{"feature": feature, "threshold": threshold}, node(left), node(n - left)]

    rows: list[dict[str, Any]] = []

    def lay(part: list[Any]) -> int:
        at = len(rows)
        rows.append(dict(part[0]))
        if len(part) == 3:
            rows[at]["left"], rows[at]["right"] = lay(part[1]), lay(part[2])
        return at

    lay(node(n_leaves))
    zero = np.zeros(spec.actions.n_outputs)
    return DecisionTree(
        children_left=np.array([row.get("left", -1) for row in rows]),
        children_right=np.array([row.get("right", -1) for row in rows]),
        feature=np.array([row.get("feature", -2) for row in rows]),
        threshold=np.array([row.get("threshold", -2.0) for row in rows]),
        value=np.array([row.get("value", zero) for row in rows]),
        actions=spec.actions,
        feature_names=features.names,
        feature_low=features.low,
        feature_high=features.high,
        groups=features.groups,
    )


def jax_loop(
    spec: EnvSpec, tree: DecisionTree, episode: int, purpose: Any = "refine", limit: int = 10**6
) -> tuple[np.float32, int, list[np.ndarray]]:
    """One episode of an environment written in JAX, step by step."""
    env: Any = spec.env
    reset, step = _jitted(env)
    words = jnp.asarray(np.array([WORDS[purpose], SEED], np.uint32))
    reset_key, step_key = jax.random.split(jax.random.fold_in(jax.random.wrap_key_data(words), episode))
    state, x = reset(reset_key)
    total, seen = np.float32(0), []
    while True:
        seen.append(np.asarray(x))
        action = np.asarray(tree.predict(seen[-1]))
        action = action.astype(np.float32 if action.dtype.kind == "f" else np.int32)
        state, (x, reward, terminated, truncated) = step(
            jax.random.fold_in(step_key, len(seen) - 1), state, action
        )
        total = total + np.float32(reward)
        if terminated or truncated or len(seen) >= limit:
            return total, len(seen), seen


@functools.cache
def _jitted(env: Any) -> tuple[Any, Any]:
    return jax.jit(env.reset), jax.jit(env.step)


def looped(spec: EnvSpec, trees: list[DecisionTree], episodes: range, purpose: Any = "refine") -> Played:
    results = [[jax_loop(spec, tree, episode, purpose)[:2] for episode in episodes] for tree in trees]
    returns, lengths = (np.array([[result[i] for result in row] for row in results]) for i in (0, 1))
    return Played(returns.astype(np.float32), lengths.astype(np.int32))


def assert_same(ours: Played, theirs: Played, *, exact: bool = True) -> None:
    np.testing.assert_array_equal(ours.lengths, theirs.lengths)
    np.testing.assert_allclose(
        ours.returns, theirs.returns, rtol=0 if exact else 2e-5, atol=0 if exact else 1e-4
    )
    assert ours.returns.dtype == np.float32
    assert ours.lengths.dtype == np.int32


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
    arena = make_arena(spec, SEED)
    crowd = [grown(spec, 1 + seed % MAX_LEAVES, seed) for seed in range(160)]
    in_crowd = arena.play(crowd, episodes)
    # of random trees most play alike: look at some that do not
    unlike = np.unique(in_crowd.lengths * 1000 + in_crowd.returns, axis=0, return_index=True)[1]
    some = unlike[:: max(1, len(unlike) // 5)]
    trees = [crowd[i] for i in some] + [grown(spec, 45, 9)]
    theirs = looped(spec, trees, episodes)
    by_links = arena.play(trees, episodes)
    assert_same(by_links, theirs, exact=exact)
    np.testing.assert_array_equal(by_links.returns[:-1], in_crowd.returns[some])
    np.testing.assert_array_equal(by_links.lengths[:-1], in_crowd.lengths[some])
    assert arena.steps == in_crowd.lengths.sum() + by_links.lengths.sum()
    assert len(unlike) > 4, "all trees play alike: this tests nothing"


def test_bits_are_the_leaf_that_walking_ends_in():
    """Also for NaN, infinite numbers, signed zeros, ties, and every shape of tree."""
    spec = spec_of("CartPole-v1")
    trees = [grown(spec, 1 + n % MAX_LEAVES, n) for n in range(96)]
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, (40, 4)).astype(np.float32)
    special = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 0.5], np.float32)
    x = np.where(rng.random(x.shape) < 0.3, rng.choice(special, x.shape), x)
    forest = Masked.of(trees, len(trees))
    which = np.repeat(np.arange(len(trees)), len(x))
    leaves = _leaves(forest, which, np.tile(x, (len(trees), 1))).reshape(len(trees), len(x))
    for tree, leaf in zip(trees, leaves, strict=True):
        np.testing.assert_array_equal(np.flatnonzero(tree.is_leaf)[leaf], tree.apply(x))


@jax.jit
def _apply(forest: Masked, which: Any, x: Any) -> Any:
    return forest.apply(which, forest.held(which), x)


def _leaves(forest: Masked, which: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.asarray(_apply(forest, which.astype(np.int32), x))


def test_many_features_are_looked_up():
    spec = spec_of("MiniGrid-LavaGapS5-v0")
    tree = grown(spec, 20, 3)
    rng = np.random.default_rng(0)
    x = np.zeros((200, len(spec.features.names)), np.float32)
    for group in spec.features.groups:
        x[np.arange(len(x)), rng.choice(group.features, len(x))] = 1
    forest, which = Masked.of([tree], 1), np.zeros(len(x), int)
    leaf = _leaves(forest, which, x)
    assert len(np.unique(leaf)) > 2
    np.testing.assert_array_equal(np.flatnonzero(tree.is_leaf)[leaf], tree.apply(x))


def test_rows_beyond_the_nodes_clear_nothing():
    forest = Masked.of([grown(spec_of("CartPole-v1"), 3, 0)], 2)
    assert (forest.mask[0, 2:] == ALL).all()
    assert (forest.mask[1] == ALL).all()
    assert forest.num_blocks == 1


def compiled_case() -> tuple[Arena, list[DecisionTree]]:
    spec = spec_of("CartPole-v1")
    return make_arena(spec, SEED), [grown(spec, 2 + n, n) for n in range(12)]


def host_case() -> tuple[Arena, list[DecisionTree]]:
    spec = resolve("CartPole-v1", backend="host")
    return make_arena(spec, SEED), [grown(spec, 2 + n, n) for n in range(12)]


def pool_case() -> tuple[Arena, list[DecisionTree]]:
    if not is_installed():
        pytest.skip("envpool is not installed")
    spec = resolve("LunarLander-v3", backend="envpool")
    return make_arena(spec, SEED), [grown(spec, 2 + n, n) for n in range(6)]


EVERYWHERE = pytest.mark.parametrize("case", [compiled_case, host_case, pool_case], ids=lambda c: c.__name__)


@EVERYWHERE
def test_an_episode_is_the_same_whatever_else_is_in_the_call(case):
    arena, trees = case()
    all_of_them = arena.play(trees, range(40, 60))
    for some, episodes in (
        (trees[::-1], range(40, 60)),
        (trees[2:4], range(45, 47)),
        (trees[:1] * 3, range(59, 60)),
    ):
        again = arena.play(some, episodes)
        where = [trees.index(tree) for tree in some]
        columns = slice(episodes.start - 40, episodes.stop - 40)
        np.testing.assert_array_equal(again.returns, all_of_them.returns[where, columns])
        np.testing.assert_array_equal(again.lengths, all_of_them.lengths[where, columns])
    assert len(np.unique(all_of_them.returns)) > 20


@EVERYWHERE
def test_observations_are_those_that_the_tree_acts_on(case):
    arena, trees = case()
    # 16 are watched at once; 21 are one and a bit
    lengths = arena.play(trees[3:4], range(5, 26)).lengths[0]
    before = arena.steps
    seen = arena.observe(trees[3], range(5, 26))
    assert arena.steps - before == len(seen) == lengths.sum()
    assert seen.dtype == np.float32
    ends = np.cumsum(lengths)
    for episode in (0, 15, 16, 20):
        alone = arena.observe(trees[3], range(5 + episode, 6 + episode))
        np.testing.assert_array_equal(alone, seen[ends[episode] - lengths[episode] : ends[episode]])


@EVERYWHERE
def test_episodes_to_search_with_are_not_those_to_choose_with(case):
    arena, trees = case()
    others = [make_arena(arena.spec, SEED, "validation"), make_arena(arena.spec, SEED + 1)]
    first = [each.observe(trees[0], range(4)) for each in (arena, *others)]
    starts = [{row.tobytes() for row in rows} for rows in first]
    assert not starts[0] & starts[1]
    assert not starts[0] & starts[2]
    again = type(arena)(arena.spec, SEED).observe(trees[0], range(4))
    np.testing.assert_array_equal(again, first[0])


def test_what_a_compiled_arena_shows_is_what_the_loop_sees():
    arena, trees = compiled_case()
    seen = [row for episode in range(3) for row in jax_loop(arena.spec, trees[5], episode)[2]]
    np.testing.assert_array_equal(arena.observe(trees[5], range(3)), np.stack(seen))


def test_more_than_one_call_holds_is_done_in_several(monkeypatch):
    arena, trees = compiled_case()
    whole = arena.play(trees, range(2, 9))
    monkeypatch.setattr(compiled, "MAX_TREES", 5)
    by_trees = arena.play(trees, range(2, 9))
    monkeypatch.setattr(compiled, "MAX_JOBS", 3)
    by_episodes = arena.play(trees[:4], range(2, 9))
    assert_same(by_trees, whole)
    assert_same(by_episodes, Played(whole.returns[:4], whole.lengths[:4]))


def test_more_episodes_than_a_call_holds():
    arena, trees = compiled_case()
    worst = [min(trees, key=lambda tree: arena.play([tree], range(8)).lengths.mean())]
    played = arena.play(worst, range(lanes.MAX_JOBS + 40))
    assert played.lengths.shape == (1, lanes.MAX_JOBS + 40)
    assert played.lengths.min() >= 1
    for last in (
        range(lanes.MAX_JOBS - 2, lanes.MAX_JOBS + 3),
        range(lanes.MAX_JOBS + 35, lanes.MAX_JOBS + 40),
    ):
        np.testing.assert_array_equal(
            arena.play(worst, last).lengths, played.lengths[:, last.start : last.stop]
        )


def test_an_environment_without_a_clock_gets_one(monkeypatch):
    monkeypatch.setattr(lanes, "MAX_EPISODE_STEPS", 37)
    lanes.player.cache_clear()
    lanes.watcher.cache_clear()
    spec = resolve(Endless())
    right, wrong = (_of_parity(spec, swapped) for swapped in (False, True))
    arena = make_arena(spec, SEED)
    played = arena.play([right, wrong], range(3))
    np.testing.assert_array_equal(played.lengths, np.full((2, 3), 37))
    np.testing.assert_array_equal(played.returns, [[37] * 3, [0] * 3])
    np.testing.assert_array_equal(arena.observe(right, range(1))[:, 0], np.arange(37) % 2)
    lanes.player.cache_clear()
    lanes.watcher.cache_clear()


def _of_parity(spec: EnvSpec, swapped: bool) -> DecisionTree:
    values = np.eye(2)[::-1] if swapped else np.eye(2)
    names = spec.features.names
    return DecisionTree.from_complete(
        np.array([0]), np.array([0.5]), values, actions=spec.actions, feature_names=names
    )


def test_returns_are_distributed_as_on_gymnasium():
    spec = spec_of("CartPole-v1")
    balances = _leaning(spec)
    ours = make_arena(spec, SEED).play([balances], range(400)).returns[0]
    theirs = play(balances, spec, 200, seed=SEED, purpose="refine").returns
    error = np.sqrt(ours.var() / len(ours) + theirs.var() / len(theirs))
    assert abs(ours.mean() - theirs.mean()) < 4 * error
    assert 30 < theirs.mean() < 60


def _leaning(spec: EnvSpec) -> DecisionTree:
    """Pushes to the side that the pole leans to: 42 steps, a few more or less."""
    return DecisionTree.from_complete(
        np.array([2]), np.array([0.0]), np.eye(2), actions=spec.actions, feature_names=spec.features.names
    )


def test_on_gymnasium_it_is_what_play_brings():
    """Validation episodes have the seeds that `sympol.play` gives them: the same returns, to the bit."""
    spec = resolve("CartPole-v1", backend="host")
    trees = [grown(spec, n, n) for n in (2, 5, 40)]
    arena = make_arena(spec, SEED, "validation")
    assert isinstance(arena, hosted.HostArena)
    played = arena.play(trees, range(50))
    for tree, returns, lengths in zip(trees, *played, strict=True):
        there = play(tree, spec, 50, seed=SEED, purpose="validation")
        np.testing.assert_array_equal(returns, there.returns)
        np.testing.assert_array_equal(lengths, there.lengths)


class Counter(gymnasium.Env):
    """Starts at its seed's number and never ends; an action from 5 on, several observations of other types."""

    observation_space = gymnasium.spaces.Dict(
        {"kind": gymnasium.spaces.Discrete(3), "n": gymnasium.spaces.Box(-10, 10, (2,), np.float64)}
    )
    action_space = gymnasium.spaces.Discrete(2, start=5)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.n = self.np_random.uniform(-1, 1, 2)
        return self._see(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action), action
        self.n = self.n + (0.1 if action == 5 else -0.1) + self.np_random.normal(size=2) / 50
        return self._see(), float(self.n[0]), bool(abs(self.n[0]) > 1.3), False, {}

    def _see(self) -> dict[str, Any]:
        return {"kind": int(abs(self.n[1]) * 10) % 3, "n": self.n}


@pytest.mark.parametrize("one_copy", [False, True])
def test_any_observations_and_actions_and_the_clock_of_the_arena(one_copy):
    spec = resolve(Counter() if one_copy else Counter)
    assert spec.has_one_copy is one_copy
    trees, limit = [grown(spec, n, n) for n in (2, 6, 12)], 60
    arena = hosted.HostArena(spec, SEED)
    arena._limit = limit
    played = arena.play(trees, range(4, 7))
    for i, tree in enumerate(trees):
        for j, episode in enumerate(range(4, 7)):
            env, seen = Counter(), []
            x, total, over = env.reset(seed=episode_seed(SEED, episode, "refine"))[0], 0.0, False
            while not over and len(seen) < limit:
                seen.append(spec.features.flatten(x))
                x, reward, over, _, _ = env.step(tree.predict(seen[-1]))
                total += reward
            assert played.returns[i, j] == np.float32(total)
            assert played.lengths[i, j] == len(seen)
            np.testing.assert_array_equal(arena.observe(tree, range(episode, episode + 1)), np.stack(seen))


@pytest.mark.parametrize("name", ["LunarLander-v3", "LunarLanderContinuous-v3"])
def test_in_a_pool_it_is_what_a_pool_of_one_brings(name):
    if not is_installed():
        pytest.skip("envpool is not installed")
    spec = resolve(name, backend="envpool")
    trees = [grown(spec, n, n) for n in (3, 20)]
    played = make_arena(spec, SEED).play(trees, range(70, 73))
    from sympol.envs.pool import make_pool
    from sympol.trees.floats import flushed

    for i, tree in enumerate(trees):
        for j, episode in enumerate(range(70, 73)):
            pool = make_pool(name, [episode_seed(SEED, episode, "refine") >> 2 << 1])
            x, total, length, over = pool.reset()[0], 0.0, 0, False
            while not over:
                x, reward, terminated, truncated, _ = pool.step(
                    tree.predict(flushed(x)).astype(np.int32 if "Cont" not in name else np.float32)
                )
                total, length, over = (
                    total + float(reward[0]),
                    length + 1,
                    bool(terminated[0] or truncated[0]),
                )
            assert played.lengths[i, j] == length
            assert played.returns[i, j] == np.float32(total)


def test_seeds_are_never_a_test_s():
    tests = {episode_seed(SEED, episode) for episode in range(1000)}
    for purpose in ("refine", "validation"):
        seeds = {episode_seed(SEED, episode, purpose) for episode in range(1000)}
        assert not seeds & tests
        assert len(seeds) == 1000
    assert len(set(WORDS.values())) == len(WORDS)


@EVERYWHERE
def test_what_cannot_be_played_is_refused(case):
    arena, trees = case()
    with pytest.raises(ValueError, match="0 trees and 3 episodes"):
        arena.play([], range(3))
    with pytest.raises(ValueError, match="1 trees and 0 episodes"):
        arena.play(trees[:1], range(3, 3))
    for episodes in (range(0, 9, 2), range(-3, 4), range(2**31, 2**31 + 2)):
        with pytest.raises(ValueError, match="consecutive numbers between 0 and 2147483647"):
            arena.play(trees[:1], episodes)
    other = grown(spec_of("Pendulum-v1"), 3, 0)
    with pytest.raises(ValueError, match="a tree of 3 features cannot play"):
        arena.observe(other, range(3))
    assert arena.steps == 0


def test_a_tree_for_other_actions_is_refused():
    spec = spec_of("CartPole-v1")
    arena, names = make_arena(spec, SEED), spec.features.names
    others = [DiscreteActions(2, start=1), BoxActions((-1, -1), (1, 1), (2,)), DiscreteActions(3)]
    for actions in others:
        tree = DecisionTree.from_complete(
            np.array([2]), np.array([0.0]), np.eye(2, actions.n_outputs), actions=actions, feature_names=names
        )
        with pytest.raises(ValueError, match="cannot play CartPole-v1"):
            arena.play([tree], range(2))
    named = DecisionTree.from_complete(
        np.array([2]),
        np.array([0.0]),
        np.eye(2),
        actions=DiscreteActions(2, ("links", "rechts")),
        feature_names=names,
    )
    assert arena.play([named], range(1)).returns.shape == (1, 1)


def test_a_seed_or_purpose_that_there_is_not():
    spec: Any = spec_of("CartPole-v1")
    for seed in (-1, 2**32):
        with pytest.raises(ValueError, match="seed must be between 0"):
            make_arena(spec, seed)
    purpose: Any = "test"
    with pytest.raises(ValueError, match="refine, validation, got 'test'"):
        make_arena(spec, 0, purpose)


def test_rewards_that_are_no_numbers():
    spec = resolve(Broken())
    with pytest.raises(EnvironmentFailure, match=r"not finite in float32: tree 0 in episode 4 got inf"):
        make_arena(spec, SEED).play([_of_parity(spec, False)], range(4, 6))
