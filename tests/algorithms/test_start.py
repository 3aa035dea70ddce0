"""Training that starts from a tree: it is that tree at first, and what is frozen is so at the end."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete

import sympol
from sympol import DecisionTree, Start
from sympol.agents import Agent, Report
from sympol.algorithms.config import ConfigError
from sympol.algorithms.data_init import init_from_tree
from sympol.algorithms.optim import apply_gradients, frozen
from sympol.algorithms.state import Normalizer
from sympol.envs.registry import resolve
from sympol.policies.embed import places
from sympol.policies.tree import Tree
from sympol.trees import BoxActions, DiscreteActions, Group, MultiDiscreteActions
from sympol.trees.override import override
from sympol.trees.verify import Property, verify
from sympol.types import Transition
from tests.tiny import TINY, Chain, quick_compiles
from tests.trees.samples import telling_observations

__all__ = ["quick_compiles"]

INF = np.inf


def hand_written(value: Any = ((1, 0), (0, 1), (0.5, 2)), **changes: Any) -> DecisionTree:
    """If the pole leans right: push right. Else by its speed."""
    leaves = np.array(value, np.float32)
    zeros = np.zeros(leaves.shape[1])
    tree = DecisionTree(
        children_left=np.array([1, 2, -1, -1, -1]),
        children_right=np.array([4, 3, -1, -1, -1]),
        feature=np.array([2, 3, -2, -2, -2]),
        threshold=np.float32([0.03, 0.1, -2, -2, -2]),
        value=np.stack([zeros, zeros, *leaves]),
        actions=DiscreteActions(2),
        feature_names=tuple(f"x[{i}]" for i in range(4)),
        feature_low=np.full(4, -INF),
        feature_high=np.full(4, INF),
    )
    return replace(tree, **changes)


TREE = hand_written()
LAST: dict[str, Any] = {"select_best": False, "rollback": False}
"""What was learnt last, be it better or not."""

RIGHT = (0, 4)
"""The rule on top: beyond a lean of 0.03, right."""


def agent(start: Any = TREE, algorithm: type[Agent] = sympol.PPO, **options: Any) -> Agent:
    config = {**TINY, "num_epochs": 1, **options}
    if algorithm is sympol.A2C:
        config = {
            name: value for name, value in config.items() if name not in ("minibatch_size", "num_epochs")
        }
    return algorithm("tree", options.pop("env", "CartPole-v1"), start=start, **config)


def learnt(start: Any = TREE, algorithm: type[Agent] = sympol.PPO, **options: Any) -> Agent:
    return agent(start, algorithm, **options).learn(progress_bar=False)


def until(begun: Agent, timestep: int) -> Agent:
    return begun.learn(callback=lambda report: report.timestep < timestep, progress_bar=False)


def observations(tree: DecisionTree, n: int = 10_000) -> np.ndarray:
    return telling_observations(tree, np.random.default_rng(0), n)


def parameters(trained: Agent) -> Tree:
    assert trained.state is not None
    actor: Any = trained.state.networks.actor
    return jax.tree.map(np.asarray, actor)


def bits(array: Any) -> bytes:
    return np.asarray(array).tobytes()


@pytest.mark.parametrize("algorithm", [sympol.PPO, sympol.A2C])
def test_before_the_first_update_it_is_the_tree_it_started_from(algorithm):
    begun, x = agent(algorithm=algorithm, **LAST), observations(TREE)
    np.testing.assert_array_equal(begun.tree().predict(x), TREE.predict(x))
    np.testing.assert_array_equal(begun.predict(np.nan_to_num(x))[0], TREE.predict(np.nan_to_num(x)))
    until(begun, 0)
    assert begun.num_timesteps == begun.config.chunk_size  # one rollout, and nothing learnt from it
    full = begun.tree(prune=False)
    np.testing.assert_array_equal(full.predict(x), TREE.predict(x))
    np.testing.assert_array_equal(begun.tree().predict(x), TREE.predict(x))
    # its certain leaves are certain no more, the other is as it was
    given = np.float32([[0.7, 0.3], [0.3, 0.7], np.exp([0.5, 2]) / np.exp([0.5, 2]).sum()])
    np.testing.assert_allclose(full.predict_proba(x), given[TREE.apply(x) - 2], rtol=1e-6)
    assert set(full.threshold[full.feature == 2]) >= {np.float32(0.03)}
    assert begun.state is not None
    assert not np.array_equal(begun.state.normalizer.scale, np.ones(4))  # it is scaled all the same
    begun.learn(progress_bar=False)
    assert (begun.tree(prune=False).predict_proba(x) != full.predict_proba(x)).any()


def test_the_first_validation_is_of_the_tree_so_what_is_returned_is_no_worse():
    reports: list[Report] = []
    trained = agent(learning_rate_leaf_values=1.0).learn(callback=reports.append, progress_bar=False)
    assert reports[0].timestep == trained.config.chunk_size
    assert trained.state is not None
    first, best = reports[0].metrics["eval/mean_reward"], float(trained.state.validation.best_return)
    assert best == max(report.metrics["eval/mean_reward"] for report in reports) >= first


def test_what_is_frozen_stays_to_the_bit_and_the_rest_learns():
    free, frozen = learnt(), learnt(Start(TREE, freeze=RIGHT))
    begun = parameters(until(agent(Start(TREE, freeze=RIGHT)), 0))
    where = places(TREE, frozen.config.depth)
    ended, went = parameters(frozen), parameters(free)
    # depth 3: the root, and all that fills up its right half, leaves 4 to 7
    splits, leaves = np.array([0, 2, 5, 6]), np.array([4, 5, 6, 7])
    assert set(where.leaf[leaves]) == {4}
    for name, fixed in (("feature_logits", splits), ("thresholds", splits), ("leaf_values", leaves)):
        before, after = getattr(begun, name), getattr(ended, name)
        assert bits(before[fixed]) == bits(after[fixed]), name
        rest = np.setdiff1d(np.arange(len(before)), fixed)
        assert (before[rest] != after[rest]).any(axis=1).all(), name
        assert (before[fixed] != getattr(went, name)[fixed]).any(), name  # it would have learnt
    assert bits(ended.leaf_values[leaves]) == bits(np.tile(TREE.value[4], (4, 1)))

    tree, x = frozen.tree(), observations(TREE)
    assert (tree.feature[0], tree.threshold[0]) == (2, np.float32(0.03))
    inside = x[~(x[:, 2] <= np.float32(0.03))]
    assert len(inside) > 1000
    assert (tree.predict(inside) == 1).all()


def test_a_frozen_split_keeps_its_threshold_while_its_leaves_learn():
    frozen = learnt(freeze=(1,))
    begun, ended = parameters(until(agent(), 0)), parameters(frozen)
    assert bits(begun.thresholds[1]) == bits(ended.thresholds[1])
    assert bits(begun.feature_logits[1]) == bits(ended.feature_logits[1])
    assert (begun.leaf_values != ended.leaf_values).any(axis=1).all()
    assert (begun.thresholds[[0, 2]] != ended.thresholds[[0, 2]]).any(axis=1).all()


def test_a_rule_forced_on_top_holds_to_the_end():
    """Proven of what is returned, for every observation there is; without freezing its questions would have moved."""
    left = hand_written(
        feature_names=resolve("CartPole-v1").features.names, actions=resolve("CartPole-v1").actions
    )
    condition = "pole angle > 0 and cart position > -1"
    rule = Property(f"when {condition} then action is push left", within_bounds=False)
    forced = override(left, condition, "push left")
    fast = {"learning_rate_thresholds": 0.3, "learning_rate_leaf_values": 0.3}
    for freeze in (forced.nodes, condition):
        begun = agent(Start(forced.tree, critic_warmup=0.0), freeze=freeze, depth=5, **fast)
        assert begun.start is not None
        assert begun.start.freeze == forced.nodes
        ended = begun.learn(progress_bar=False).tree(prune=False)
        assert [verdict.holds for verdict in verify(ended, [rule])] == [True]
        assert [verdict.holds for verdict in verify(ended.prune(), [Property(rule.rule)])] == [True]
        assert set(asked(forced.tree)) <= set(asked(ended))
    free = learnt(Start(forced.tree, critic_warmup=0.0), depth=5, **fast, select_best=False)
    assert not set(asked(forced.tree)) & set(asked(free.tree(prune=False)))


def asked(tree: DecisionTree) -> list[tuple[int, float]]:
    """The two questions that the rule is made of: where the cart is, and whether the pole leans right."""
    inner = zip(tree.feature.tolist(), tree.threshold.tolist(), strict=True)
    return [
        (feature, threshold) for feature, threshold in inner if (feature, threshold) in ((0, -1.0), (2, 0.0))
    ]


@pytest.mark.parametrize("algorithm", [sympol.PPO, sympol.A2C])
def test_while_the_critic_warms_up_nothing_else_learns(algorithm):
    start = Start(TREE, critic_warmup=0.5)
    first, warm = (until(agent(start, algorithm, **LAST), stop) for stop in (0, 700))
    assert first.state is not None
    assert warm.state is not None
    for before, after in zip(*(jax.tree.leaves(parameters(a)) for a in (first, warm)), strict=True):
        assert bits(before) == bits(after)
    critics = (jax.tree.leaves(a.state.networks.critic) for a in (first, warm))
    assert all((np.asarray(a) != np.asarray(b)).any() for a, b in zip(*critics, strict=True))
    validation = warm.state.validation
    # standing still is no plateau
    assert (int(validation.num_bad), float(validation.lr_factor)) == (0, 1.0)
    warm.learn(progress_bar=False)
    assert bits(parameters(warm).leaf_values) != bits(parameters(first).leaf_values)


def test_splits_that_only_fill_up_split_what_comes_by_and_learn():
    x = observations(TREE)
    begun = until(agent(start := Start(hand_written(((1, 0), (1, 0), (0, 1))), critic_warmup=0.0)), 0)
    ended = learnt(start)
    filling = places(start.tree, 3).split < 0
    before, after = parameters(begun), parameters(ended)
    assert filling.sum() == 5
    assert (before.feature_logits[filling] != after.feature_logits[filling]).any()
    assert (before.thresholds[filling] != after.thresholds[filling]).any()
    # all lie where observations are: on what the tree meets, both sides of most of them are visited
    full = begun.tree(prune=False)
    met = visited(full)
    assert np.count_nonzero(full.with_visits(met).n_node_samples[full.is_leaf]) >= 6
    assert len(np.unique(full.predict(x))) == 2


def visited(policy: DecisionTree) -> np.ndarray:
    env, rows = gymnasium.make("CartPole-v1"), []
    for seed in range(30):
        x, done = env.reset(seed=seed)[0], False
        while not done:
            rows.append(x)
            x, _, terminated, truncated, _ = env.step(int(policy.predict(x)))
            done = terminated or truncated
    return np.array(rows)


def test_stopped_saved_and_gone_on_with_it_ends_as_if_it_never_stopped(tmp_path):
    start = Start(TREE, freeze=RIGHT, origin="by hand")
    whole = learnt(start)
    for stop in (0, 700):
        until(agent(start), stop).save(tmp_path / str(stop))
        again = sympol.load(tmp_path / str(stop))
        assert again.start == start.fitted(again.spec)
        assert again.learn(progress_bar=False).tree(prune=False) == whole.tree(prune=False)
    agent(start).save(tmp_path / "new")  # before the first checkpoint
    new = sympol.load(tmp_path / "new")
    np.testing.assert_array_equal(new.tree().predict(observations(TREE)), TREE.predict(observations(TREE)))
    assert new.learn(progress_bar=False).tree(prune=False) == whole.tree(prune=False)
    config = (tmp_path / "new" / "config.toml").read_text()
    assert 'origin = "by hand"' in config
    assert json.loads((tmp_path / "new" / "start.json").read_text())["nodes"][0]["threshold"] == 0.03


def test_the_seed_decides_only_what_is_learnt():
    one, other = (until(agent(seed=seed), 0).tree(prune=False) for seed in (0, 1))
    x = observations(TREE)
    np.testing.assert_array_equal(one.predict(x), other.predict(x))
    assert one != other  # what fills up is drawn


def test_the_depth_is_the_presets_or_the_trees():
    assert sympol.PPO("tree", "CartPole-v1", start=TREE).config.depth == 5
    deep = TREE
    for _ in range(6):
        deep = on_top(deep)
    assert deep.depth == 8
    assert sympol.PPO("tree", "CartPole-v1", start=deep).config.depth == 8
    with pytest.raises(ConfigError, match=r"has depth 8, which does not fit into depth 5: choose --depth 8"):
        sympol.PPO("tree", "CartPole-v1", start=deep, depth=5)


def on_top(tree: DecisionTree) -> DecisionTree:
    """The same tree to the right of one more split."""
    arrays: dict[str, Any] = {
        "children_left": np.concatenate([[1, -1], np.where(tree.is_leaf, -1, tree.children_left + 2)]),
        "children_right": np.concatenate([[2, -1], np.where(tree.is_leaf, -1, tree.children_right + 2)]),
        "feature": np.concatenate([[0, -2], tree.feature]),
        "threshold": np.concatenate([[-1, -2], tree.threshold]),
        "value": np.concatenate([np.zeros_like(tree.value[:1]), tree.value[-1:], tree.value]),
    }
    return replace(tree, **arrays)


THREE: dict[str, Any] = {
    "feature_names": ("a", "b", "c"),
    "feature_low": np.zeros(3),
    "feature_high": np.ones(3),
    "feature": np.array([2, 1, -2, -2, -2]),
}
MIXED_UP = ("cart position (m)", "pole angle (rad)", "cart velocity (m/s)", "pole angular velocity (rad/s)")
PAIR = Group("", (0, 1), ("a", "b"))
SWAPPED = DiscreteActions(2, ("push right", "push left"))
BOX = BoxActions((0.0, 0.0), (1.0, 1.0), (2,))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (THREE, "looks at 3 features, but CartPole-v1 has 4"),
        (
            {"feature_names": MIXED_UP},
            r"feature 1 'pole angle \(rad\)', but in CartPole-v1 it is 'cart velocity",
        ),
        ({"groups": (PAIR,)}, r"features \(0, 1\) are one-hot, but not in CartPole-v1"),
        ({"actions": SWAPPED}, "calls its actions 'push right', 'push left'"),
        ({"actions": DiscreteActions(2, start=1)}, "start=1.*but CartPole-v1 takes"),
        ({"actions": BOX}, "but CartPole-v1 takes"),
    ],
)
def test_a_tree_for_something_else_is_refused(changes, says):
    with pytest.raises(ValueError, match=says):
        agent(hand_written(**changes))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"freeze": (5,)}, "numbers of nodes of the tree to start from, 0 to 4, got 5"),
        ({"freeze": (-1,)}, "got -1"),
        ({"freeze": (True,)}, "got True"),
        ({"freeze": ("rule",)}, "got 'rule'"),
        ({"confidence": 0.5}, "confidence must be above 0.5"),
        ({"confidence": 1.1}, "at most 1, got 1.1"),
        ({"confidence": float("nan")}, "got nan"),
        ({"critic_warmup": 1.0}, "critic_warmup must be from 0 to less than 1"),
        ({"critic_warmup": -0.1}, "got -0.1"),
    ],
)
def test_a_start_that_makes_no_sense_is_refused(options, says):
    with pytest.raises(ValueError, match=says):
        Start(TREE, **options)


def test_only_a_tree_starts_from_a_tree_and_only_a_start_is_frozen():
    with pytest.raises(ConfigError, match="only a tree can start from a tree; policy is 'mlp'"):
        sympol.PPO("mlp", "CartPole-v1", start=TREE)
    with pytest.raises(ValueError, match="give start, too"):
        sympol.PPO("tree", "CartPole-v1", freeze=(0,))


@pytest.mark.parametrize("kind", ["box", "multi_discrete"])
def test_through_the_host_with_other_actions_and_one_hot_features(kind):
    """A category of three as observation; the frozen half of the tree is what it was, its noise may move."""
    actions, space = {
        "box": (BoxActions((-1.0, -1.0), (1.0, 1.0), (2,), std=(0.5, 0.25)), Box(-1, 1, (2,))),
        "multi_discrete": (MultiDiscreteActions((2, 3)), MultiDiscrete([2, 3])),
    }[kind]
    env = Chain(Discrete(3), space)
    rng = np.random.default_rng(0)
    tree = DecisionTree.from_complete(
        np.array([1, 0, 2]), np.full(3, 0.5), np.round(2 * rng.normal(size=(4, actions.n_outputs))), actions=actions
    )  # fmt: skip
    begun = sympol.PPO(
        "tree", env, start=Start(tree, freeze=(0, 4, 5, 6), critic_warmup=0.0),
        total_timesteps=256, depth=3, num_steps=16, num_evals=2, num_eval_episodes=2, critic_hidden=(4,),
    )  # fmt: skip
    x = np.eye(3, dtype=np.float32)
    until(begun, 0)
    np.testing.assert_array_equal(begun.tree(prune=False).predict(x), tree.predict(x))
    if isinstance(begun.actions, BoxActions):
        np.testing.assert_allclose(begun.actions.std, (0.5, 0.25), rtol=1e-6)
    begun.learn(progress_bar=False)
    ended = begun.tree(prune=False)
    np.testing.assert_array_equal(ended.value[ended.apply(x[1])], tree.value[tree.apply(x[1])])
    assert (ended.value[ended.apply(x[:1])] != tree.value[tree.apply(x[:1])]).all()


def test_the_gradient_of_what_is_held_counts_for_nothing():
    """Not in the norm that is clipped: beside a huge one the others would be nothing."""
    begun = until(agent(Start(TREE, freeze=RIGHT)), 0)
    assert begun.state is not None
    state, config = begun.state._replace(timestep=jnp.int32(1000)), begun.config
    mask = frozen(config, state)
    assert mask is not None
    ones = jax.tree.map(jnp.ones_like, state.networks)
    huge = jax.tree.map(lambda still, one: jnp.where(still, 1e9 * one, one), mask, ones)
    hyper = replace(config, max_grad_norm=1.0).hyperparameters()
    step = jax.jit(
        lambda gradient: apply_gradients(
            state.networks, gradient, state.opt_state, hyper, jnp.float32(1), mask
        )
    )
    for a, b in zip(*(jax.tree.leaves(step(gradient)) for gradient in (ones, huge)), strict=True):
        assert bits(a) == bits(b)


def test_the_best_tree_so_far_is_scaled_with_the_others():
    """Should every validation be NaN, it is the tree that was started from, not one over other units."""
    settled = until(agent(), 0).state
    assert settled is not None
    fresh = settled._replace(normalizer=Normalizer(jnp.zeros(4), jnp.ones(4)))
    rows = jnp.asarray(np.random.default_rng(0).normal(size=(1, 16, 4, 4)), jnp.float32)
    rollout = Transition(rows, *(jnp.zeros((1, 16, 4)) for _ in range(4)), rows)
    scaling = (Normalizer(jnp.zeros(4), jnp.ones(4)), np.zeros(4, bool))
    again = init_from_tree(scaling, fresh, rollout, jax.random.key(0))
    pairs = zip(
        jax.tree.leaves(again.validation.best_actor), jax.tree.leaves(again.networks.actor), strict=True
    )
    assert all(bits(a) == bits(b) for a, b in pairs)
