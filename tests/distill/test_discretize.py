"""The hard tree in a soft one: where they must agree they do, to the bit, and a plain loop gives the same."""

from __future__ import annotations

from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.distill.discretize import discretize
from sympol.distill.teacher import log_softmax
from sympol.envs.spaces import action_spec
from sympol.policies.soft_tree import SoftTree
from sympol.teachers import discretize_agent, teacher_of

from ..tiny import TINY, Chain, quick_compiles

__all__ = ["quick_compiles"]

FEATURES, DEPTH = 3, 3
NODES = 2**DEPTH - 1


def soft_tree(logits: Any, seed: int = 0, temperature: float = 1.0, **parts: Any) -> SoftTree:
    """A soft tree whose leaves say plainly different things."""
    rng = np.random.default_rng(seed)
    values = {
        "thresholds": rng.normal(size=NODES).astype(np.float32),
        "leaf_values": rng.permutation((NODES + 1) * 4).reshape(NODES + 1, 4).astype(np.float32),
        **parts,
    }
    arrays = {name: jnp.asarray(value) for name, value in values.items()}
    return SoftTree(
        feature_logits=jnp.asarray(logits, jnp.float32),
        log_std=jnp.zeros(0),
        temperature=temperature,
        **arrays,
    )


def hard_tree(actor: SoftTree, shift: Any = (0, 0, 0), scale: Any = (1, 1, 1)) -> sympol.DecisionTree:
    return discretize(
        actor,
        np.float32(shift),
        np.float32(scale),
        actions=action_spec(gymnasium.spaces.Discrete(4)),
        feature_names=["a", "b", "c"],
        feature_low=np.full(FEATURES, -np.inf),
        feature_high=np.full(FEATURES, np.inf),
    )


def one_hot_logits(seed: int) -> np.ndarray:
    """Logits so far apart that entmax15 gives all weight to one feature."""
    return 10 * np.eye(FEATURES)[np.random.default_rng(seed).integers(FEATURES, size=NODES)]


@pytest.mark.parametrize("seed", range(5))
def test_with_one_feature_a_node_and_steep_gates_it_acts_as_its_soft_tree(seed):
    shift, scale = np.float32([0.5, -100, 3]), np.float32([2, 0.01, 30])
    actor = soft_tree(one_hot_logits(seed), seed, temperature=1e-5)
    np.testing.assert_array_equal(np.asarray(actor.weights).max(axis=1), 1)
    tree = hard_tree(actor, shift, scale)
    axis = np.linspace(-3, 3, 21) + 0.0123  # scaled; far from thresholds where a gate is not yet shut
    scaled = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, FEATURES)
    x = (scaled / scale + shift).astype(np.float32)
    seen = (x - shift) * scale
    assert np.abs(seen[:, :, None] - np.asarray(actor.thresholds)).min() > 2e-5
    outputs = np.asarray(actor(jnp.asarray(seen)))
    np.testing.assert_array_equal(tree.value[tree.apply(x)], outputs)
    np.testing.assert_array_equal(tree.predict(x), outputs.argmax(axis=1))
    assert len(np.unique(tree.apply(x))) > 3


def loops(actor: SoftTree, x: np.ndarray) -> list[np.ndarray]:
    weights, thresholds, leaves = map(np.asarray, (actor.weights, actor.thresholds, actor.leaf_values))
    return [leaves[loop(weights, thresholds, row)] for row in x]


def loop(weights: np.ndarray, thresholds: np.ndarray, x: np.ndarray) -> int:
    """The leaf of one scaled observation, in words: compare the heaviest feature with τ / w."""
    node = 0
    for _ in range(DEPTH):
        heaviest = 0
        for feature in range(1, FEATURES):
            if weights[node, feature] > weights[node, heaviest]:
                heaviest = feature
        left = x[heaviest] <= thresholds[node] / weights[node, heaviest]
        node = 2 * node + (1 if left else 2)
    return node - NODES


@pytest.mark.parametrize("seed", range(5))
def test_it_is_a_plain_loop_over_the_heaviest_features(seed):
    rng = np.random.default_rng(seed)
    actor = soft_tree(rng.normal(size=(NODES, FEATURES)), seed)
    assert (np.asarray(actor.weights).max(axis=1) < 1).any()
    tree = hard_tree(actor)
    x = rng.normal(size=(500, FEATURES)).astype(np.float32)
    thresholds = tree.threshold[~tree.is_leaf]
    x[:100] = rng.choice(
        np.concatenate([thresholds, np.nextafter(thresholds, np.float32(9))]), (100, FEATURES)
    )
    np.testing.assert_array_equal(tree.value[tree.apply(x)], loops(actor, x))


@pytest.mark.parametrize("seed", range(3))
def test_thresholds_are_unscaled_exactly(seed):
    rng = np.random.default_rng(seed)
    shift, scale = np.float32([1000, -0.3, 0]), np.float32([0.001, 7, 1e6])
    actor = soft_tree(rng.normal(size=(NODES, FEATURES)), seed)
    tree = hard_tree(actor, shift, scale)
    thresholds = tree.threshold[~tree.is_leaf]
    beside = np.concatenate([thresholds, np.nextafter(thresholds, np.float32(np.inf))])
    x = rng.choice(beside, (300, FEATURES))
    np.testing.assert_array_equal(tree.value[tree.apply(x)], loops(actor, (x - shift) * scale))


def test_half_weights_double_the_threshold_whatever_its_sign():
    logits = np.zeros((NODES, FEATURES))
    logits[:, :2] = 10  # half for each of two: the first counts
    for sign in (-1, 1):
        tree = hard_tree(soft_tree(logits, thresholds=np.full(NODES, sign * 0.25, np.float32)))
        inner = ~tree.is_leaf
        assert (tree.feature[inner] == 0).all()
        np.testing.assert_allclose(tree.threshold[inner], sign * 0.5, rtol=1e-6)


def test_left_is_where_the_gate_is_more_than_half_open():
    actor = soft_tree(one_hot_logits(0))
    tree = hard_tree(actor)
    root = int(tree.feature[0])
    x = np.zeros((2, FEATURES), np.float32)
    x[:, root] = tree.threshold[0] + np.float32([-0.1, 0.1])
    left = tree.decision_path(x)[:, 1]
    gate = jax.nn.relu(actor.thresholds[0] - x @ np.asarray(actor.weights)[0])
    np.testing.assert_array_equal(left, np.asarray(gate) > 0)
    np.testing.assert_array_equal(left, [True, False])


SDT = {key: value for key, value in TINY.items() if key != "critic_hidden"}
MLP = {key: value for key, value in TINY.items() if key != "depth"}


@pytest.fixture(scope="module")
def agent() -> sympol.PPO:
    return sympol.PPO("sdt", "CartPole-v1", **SDT).learn(progress_bar=False)


def test_an_agent_s_hard_tree_and_pruning_moves_no_action(agent):
    full, small = discretize_agent(agent, prune=False), discretize_agent(agent)
    assert full.n_nodes == 15
    assert small.n_nodes <= 15
    assert full.feature_names == agent.spec.features.names
    x = np.random.default_rng(0).normal(size=(1000, 4)).astype(np.float32)
    np.testing.assert_array_equal(full.predict(x), small.predict(x))


def test_an_agent_is_a_teacher_with_log_probabilities(agent):
    teacher = teacher_of(agent)
    x = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32)
    np.testing.assert_array_equal(teacher.act(x), agent.predict(x)[0])
    assert teacher.action_values is not None
    values = teacher.action_values(x)
    np.testing.assert_allclose(np.exp(values).sum(axis=1), 1)
    np.testing.assert_array_equal(values.argmax(axis=1), teacher.act(x))


def test_the_components_of_an_action_have_probabilities_of_their_own():
    box, parts = gymnasium.spaces.Box(-1, 1, (2,), np.float32), gymnasium.spaces.MultiDiscrete([2, 3])
    agent = sympol.PPO("mlp", Chain(box, parts), **{**MLP, "num_envs": 1})
    logits = np.random.default_rng(0).normal(size=(4, 5))
    agent.outputs = lambda x: logits  # type: ignore[method-assign]
    values = teacher_of(agent).action_values
    assert values is not None
    chances = np.exp(values(np.zeros((4, 2), np.float32)))
    np.testing.assert_allclose(chances[:, :2].sum(axis=1), 1)
    np.testing.assert_allclose(chances[:, 2:].sum(axis=1), 1)
    np.testing.assert_array_equal(chances[:, 2:].argmax(axis=1), logits[:, 2:].argmax(axis=1))


def test_continuous_actions_have_none():
    box = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    assert teacher_of(sympol.PPO("mlp", Chain(box, box), **{**MLP, "num_envs": 1})).action_values is None


def test_large_logits_have_logarithms():
    np.testing.assert_array_equal(log_softmax(np.array([[0.0, -1e4]])), [[0, -1e4]])


def test_what_is_no_soft_tree_is_refused():
    with pytest.raises(ValueError, match="needs a teacher of policy 'sdt', got 'tree'; use the method viper"):
        discretize_agent(sympol.PPO("tree", "CartPole-v1", **TINY))
    with pytest.raises(RuntimeError, match="learn"):
        discretize_agent(sympol.PPO("sdt", "CartPole-v1", **SDT))
