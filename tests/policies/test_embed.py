"""A tree becomes the parameters of a complete one: the same actions on a million observations, scaled or not."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.data_init import exact_normalizer, next_float, normalize_at, thresholds_among
from sympol.algorithms.state import Normalizer
from sympol.functional import entmax15, select
from sympol.policies.embed import embed, leaf_logits, places
from sympol.policies.extract import extract_tree
from sympol.policies.tree import Tree
from sympol.trees import ActionSpec, BoxActions, DecisionTree, DiscreteActions, Group, MultiDiscreteActions
from tests.trees.samples import ACTIONS, SPECIAL, chain, plain_leaf, telling_observations

NUM_FEATURES, DEPTH, BATCH = 6, 10, 1000
GROUPS = (Group("front", (1, 4), ("lava", "wall")), Group("", (0, 3, 5), ("a", "b", "c")))
HUGE = np.float32([3.4028235e38, -3.4028235e38, 1.5, -1.5])


def any_shape(rng: np.random.Generator, actions: ActionSpec, groups: tuple[Group, ...] = ()) -> DecisionTree:
    """Draw a tree of any shape up to depth 10: grown leaf by leaf, so bushy, or from one side, so a vine."""
    grid = np.concatenate([rng.normal(size=8).astype(np.float32), SPECIAL, HUGE, np.float32([0.25, 0.5])])
    deepest, splits = int(rng.integers(0, DEPTH + 1)), int(rng.integers(0, 60))
    is_vine, grouped = rng.random() < 0.3, {feature for group in groups for feature in group.features}
    nodes: list[dict[str, Any]] = []

    def grow(depth: int, budget: int) -> int:
        at = len(nodes)
        nodes.append({})
        if budget == 0 or depth == deepest:
            # few values, so that there are ties between actions and leaves that are alike
            nodes[at] = {"value": rng.choice(np.float32([0, 0, 1, -0.5, 2.5, 30]), actions.n_outputs)}
            return at
        left_share = int(rng.choice([0, budget - 1]) if is_vine else rng.integers(0, budget))
        feature = int(rng.integers(NUM_FEATURES))
        asks = (
            rng.choice(np.float32([0, 0.25, 0.5]))
            if feature in grouped and rng.random() < 0.8
            else rng.choice(grid)
        )
        nodes[at] = {"feature": feature, "threshold": asks}
        nodes[at]["left"] = grow(depth + 1, left_share)
        nodes[at]["right"] = grow(depth + 1, budget - 1 - left_share)
        return at

    grow(0, splits)
    return DecisionTree(
        children_left=np.array([node.get("left", -1) for node in nodes]),
        children_right=np.array([node.get("right", -1) for node in nodes]),
        feature=np.array([node.get("feature", -2) for node in nodes]),
        threshold=np.array([node.get("threshold", -2.0) for node in nodes]),
        value=np.array([node.get("value", np.zeros(actions.n_outputs)) for node in nodes]),
        actions=actions,
        feature_names=tuple(f"f{i}" for i in range(NUM_FEATURES)),
        feature_low=np.where(rng.random(NUM_FEATURES) < 0.3, -2, -np.inf),
        feature_high=np.where(rng.random(NUM_FEATURES) < 0.3, 2, np.inf),
        groups=groups,
    )


def observations(tree: DecisionTree, rng: np.random.Generator) -> np.ndarray:
    """Draw a thousand: thresholds, the floats beside them, bounds, special ones; one-hot where the tree asks for it."""
    with np.errstate(over="ignore"):  # beside the largest float lies infinity
        x = telling_observations(tree, rng, BATCH)
    for group in tree.groups:
        x[:, group.features] = np.eye(len(group.features))[rng.integers(len(group.features), size=BATCH)]
    return x


@functools.cache
def forward() -> Any:
    """One program for all trees with as many outputs: raw observations, and the same scaled."""

    @jax.jit
    def run(actor: Tree, kept: Any, wanted: Normalizer, visited: Any, x: Any, key: Any) -> Any:
        feature, threshold = select(actor.feature_logits, actor.thresholds)
        normalizer = exact_normalizer(wanted, feature, threshold, kept)
        scaled = normalize_at(normalizer, feature, threshold)
        thresholds = thresholds_among(normalizer(visited), feature, scaled, kept, key)
        settled = Tree(actor.feature_logits, thresholds, actor.leaf_values, actor.log_std, "sigmoid", 1.0)
        ways = (actor(x), actor.rollout()(x), settled(normalizer(x)), settled.rollout()(normalizer(x)))
        return ways, settled, normalizer

    return run


def metadata(tree: DecisionTree) -> dict[str, Any]:
    names = ("actions", "feature_names", "feature_low", "feature_high", "groups", "integers")
    return {name: getattr(tree, name) for name in names}


def wanted_normalizer(rng: np.random.Generator) -> Normalizer:
    """Means far away and near, spreads from tiny to huge."""
    shift = rng.normal(size=NUM_FEATURES) * rng.choice([0, 0.01, 1, 1000], NUM_FEATURES)
    scale = np.exp(np.clip(rng.choice([1, 1, 8, 60]) * rng.normal(size=NUM_FEATURES), -80, 80))
    return Normalizer(*(jnp.asarray(part, jnp.float32) for part in (shift, scale)))


CASES = [(name, grouped) for name in ACTIONS for grouped in (False, True)]


@pytest.mark.parametrize(("name", "grouped"), CASES)
def test_embedded_trees_act_as_they_did_on_a_million_observations(name, grouped):
    """1,002 trees of any shape, 1,000 observations each, five ways to act."""
    actions, keys = ACTIONS[name], jax.random.split(jax.random.key(0), 167)
    told_apart = 0
    for seed in range(167):
        rng = np.random.default_rng([seed, grouped])
        tree = any_shape(rng, actions, GROUPS if grouped else ())
        actor = embed(tree, depth=DEPTH, rng=rng)
        kept = places(tree, DEPTH).split >= 0
        x = observations(tree, rng)
        visited = x[:64]
        ways, settled, normalizer = forward()(actor, kept, wanted_normalizer(rng), visited, x, keys[seed])
        value = leaf_logits(tree, 0.7)[tree.apply(x)]
        for outputs in ways:
            np.testing.assert_array_equal(np.asarray(outputs), value)
        np.testing.assert_array_equal(actions.decide(value), tree.predict(x))
        again = extract_tree(settled, *map(np.asarray, normalizer), **metadata(tree))
        np.testing.assert_array_equal(again.value[again.apply(x)], value)
        same_splits(tree, again)
        told_apart += len(np.unique(tree.apply(x)))
    assert told_apart > 600  # and not only trees of one leaf


def same_splits(tree: DecisionTree, complete: DecisionTree, at: int = 0, there: int = 0) -> None:
    """Walk down both together: feature and threshold of each split of the tree are still there."""
    if tree.is_leaf[at]:
        return
    assert tree.feature[at] == complete.feature[there]
    assert tree.threshold[at] == complete.threshold[there]  # -0 is 0
    same_splits(tree, complete, int(tree.children_left[at]), int(complete.children_left[there]))
    same_splits(tree, complete, int(tree.children_right[at]), int(complete.children_right[there]))


def test_the_deepest_tree_there_can_be_and_the_smallest():
    vine = chain(14, to_left=True, actions=ACTIONS["discrete"])
    actor = embed(vine, depth=14, rng=np.random.default_rng(0), confidence=1.0)
    x = np.concatenate([np.arange(-16, 3, 0.5), [np.nan, np.inf, -np.inf]]).astype(np.float32)[:, None]
    expected = np.stack([vine.value[plain_leaf(vine, row)] for row in x])
    np.testing.assert_array_equal(np.asarray(jax.jit(lambda a, x: a.rollout()(x))(actor, x)), expected)
    alone = chain(0, to_left=True, actions=ACTIONS["discrete"])
    assert places(alone, 1).split.tolist() == [-1]
    assert places(alone, 1).leaf.tolist() == [0, 0]
    outputs = embed(alone, depth=1, rng=np.random.default_rng(0), confidence=1.0).rollout()(jnp.zeros((1, 1)))
    np.testing.assert_array_equal(np.asarray(outputs)[0], alone.value[0])


def test_it_fits_or_it_is_refused():
    vine = chain(5, to_left=False, actions=ACTIONS["box"])
    with pytest.raises(ValueError, match=r"has depth 5 and does not fit into depth 4; choose --depth 5"):
        places(vine, 4)
    for depth in (0, 15):
        with pytest.raises(ValueError, match=f"depth must be between 1 and 14, got {depth}"):
            places(vine, depth)


def test_every_other_feature_can_still_come_back():
    """The chosen feature wins clearly, and entmax15 gives all the others something: their gradients are not zero."""
    rng = np.random.default_rng(0)
    tree = any_shape(rng, ACTIONS["discrete"])
    actor = embed(tree, depth=DEPTH, rng=rng)
    logits = np.asarray(actor.feature_logits)[places(tree, DEPTH).split >= 0]
    first, second = np.sort(logits, axis=1)[:, [-1, -2]].T
    assert len(logits) > 3
    assert (first - second >= 0.999).all()
    shares = np.asarray(entmax15(jnp.asarray(logits)))
    assert (shares > 0).all()
    assert (shares.max(axis=1) < 0.9).all()


def leaf(actions: ActionSpec, value: Any) -> DecisionTree:
    return replace(chain(0, to_left=True, actions=actions), value=np.float32([value]))


THREE, PAIR = DiscreteActions(3), MultiDiscreteActions((2, 3))


@pytest.mark.parametrize(
    ("actions", "value", "chances"),
    [
        (THREE, [0, 1, 0], [0.1, 0.8, 0.1]),  # an action by its number
        (THREE, np.log([1e-9, 1e-9, 1]), [0.1, 0.1, 0.8]),  # of scikit-learn
        (THREE, [0, 0, 1e38], [0.1, 0.1, 0.8]),
        (THREE, np.log([0.2, 0.3, 0.5]), [0.2, 0.3, 0.5]),
        (THREE, [0, 0, 0], [1 / 3] * 3),
        (THREE, [0, 1, 1], np.exp([0, 1, 1]) / np.exp([0, 1, 1]).sum()),  # a tie stays one
        (THREE, np.log([0.005, 0.99, 0.005]), [0.005, 0.99, 0.005]),
        (PAIR, [0, 1, 50, 0, 0], ([0.2, 0.8], [0.8, 0.1, 0.1])),
        (PAIR, [0, 0.5, 0, 0, 1], (np.exp([0, 0.5]) / np.exp([0, 0.5]).sum(), [0.1, 0.1, 0.8])),
    ],
)
def test_hard_leaves_become_a_policy_that_can_learn_and_logits_stay(actions, value, chances):
    tree = leaf(actions, value)
    soft = leaf_logits(tree, 0.8)
    parts = actions.probabilities(soft)
    for got, expected in zip(*((parts, chances) if actions is PAIR else ((parts,), (chances,))), strict=True):
        np.testing.assert_allclose(got[0], expected, rtol=1e-5)
    np.testing.assert_array_equal(actions.decide(soft), actions.decide(tree.value))
    np.testing.assert_array_equal(leaf_logits(tree, 1.0), tree.value)


def test_means_stay_and_the_noise_is_the_trees_or_else_the_presets():
    def log_std(std: tuple[float, ...] | None) -> list[float]:
        actions = BoxActions((-1.0, -1.0), (1.0, 1.0), (2,), std=std)
        tree = leaf(actions, [3.0, -0.5])
        actor = embed(tree, depth=1, rng=np.random.default_rng(0), log_std=-0.5)
        np.testing.assert_array_equal(np.asarray(actor.leaf_values), tree.value[[0, 0]])
        return np.asarray(actor.log_std).tolist()

    assert log_std(None) == [-0.5, -0.5]
    np.testing.assert_allclose(log_std((0.25, 0.0)), [np.log(0.25), -0.5], rtol=1e-6)
    assert log_std((1.0, 1e-30)) == [0.0, -10.0]


def test_a_scale_is_simpler_where_it_would_move_a_threshold():
    """Below a spread of 4, zero and the smallest normal number would be one; a shift of 8 would round 0.3."""
    wanted = Normalizer(jnp.float32([0, 0, 8, 8.1]), jnp.float32([0.25, 0.26, 1, 0.9]))
    feature, kept = jnp.int32([0, 1, 2, 3, 3]), jnp.array([True, True, True, True, False])
    normalizer = exact_normalizer(wanted, feature, jnp.float32([0, 0.5, 0.3, 9.5, 0.3]), kept)
    assert np.asarray(normalizer.shift).tolist() == [0, 0, 0, 8]
    assert np.asarray(normalizer.scale).tolist() == [1, 0.25, 1, 1]


def test_the_next_float_passes_over_subnormal_numbers():
    smallest = np.finfo(np.float32).smallest_normal
    x = jnp.float32([0, -0.0, -smallest, smallest, 1, -1, 3.4028235e38])
    expected = np.float32([smallest, smallest, 0, smallest * (1 + 2**-23), 1 + 2**-23, -1 + 2**-24, np.inf])
    np.testing.assert_array_equal(np.asarray(next_float(x)), expected)
