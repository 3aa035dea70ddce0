"""A tree acts elsewhere as it does here, on whatever an environment shows."""

from __future__ import annotations

import sys
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

import sympol
from sympol.envs.spaces import Features, action_spec
from sympol.evaluate import evaluate_policy
from sympol.serving import RecordDecisions, SymbolicPolicy
from sympol.trees import BoxActions, DecisionTree, DiscreteActions

from .trees.samples import ACTIONS, random_tree, telling_observations


class World(gymnasium.Env):
    """Shows anything in its space, and takes only what is in its space."""

    def __init__(self, observed: gymnasium.Space, taken: gymnasium.Space) -> None:
        self.observation_space, self.action_space = observed, taken

    def reset(self, *, seed: int | None = None, options: Any = None):
        super().reset(seed=seed)
        self.steps = 0
        return self.observation_space.sample(), {"fresh": True}

    def step(self, action: Any):
        assert self.action_space.contains(action), action
        self.steps += 1
        return self.observation_space.sample(), 1.0, False, self.steps >= 5, {"steps": self.steps}


WORLDS = {
    "box": (Box(-1, 1, (3,)), Discrete(3, start=-1)),
    "picture": (Box(0, 255, (2, 2, 3), np.uint8), Discrete(2)),
    "float64": (Box(-2, 5, (2,), np.float64), Box(-0.1, 0.7, (2, 1), np.float64)),
    "discrete": (Discrete(4, start=2), Discrete(2)),
    "multi": (MultiDiscrete([2, 3]), MultiDiscrete([2, 3], start=[1, -1])),
    "dict": (Dict({"b": Discrete(3), "a": Box(-1, 1, (2,)), "c": MultiBinary(2)}), MultiDiscrete([2, 2])),
    "tuple": (Tuple([Discrete(3), Box(-1, 1, ())]), Box(-1, 1, (1,))),
}


def tree_for(observed: gymnasium.Space, taken: gymnasium.Space, seed: int = 1) -> DecisionTree:
    """Draw a tree for these spaces that tells what it sees."""
    rng = np.random.default_rng(seed)
    features = Features.of(observed)
    observed.seed(seed)
    seen = features.flatten_each([observed.sample() for _ in range(50)])
    feature = rng.integers(len(features.names), size=31)
    actions = action_spec(taken)
    if isinstance(actions, BoxActions):
        actions = BoxActions(actions.low, actions.high, actions.shape, std=(0.1,) * actions.n_outputs)
    return DecisionTree.from_complete(
        feature,
        seen[rng.integers(50, size=31), feature] * 0.999,
        rng.normal(size=(32, actions.n_outputs)),
        actions=actions,
        feature_names=features.names,
        groups=features.groups,
    )


@pytest.mark.parametrize("kind", WORLDS)
def test_any_observation_gets_the_tree_s_action(kind):
    world = World(*WORLDS[kind])
    tree = tree_for(*WORLDS[kind])
    policy = SymbolicPolicy(tree, world)
    world.observation_space.seed(1)
    seen = [world.observation_space.sample() for _ in range(200)]
    expected = tree.predict(Features.of(world.observation_space).flatten_each(seen))
    for observation, action in zip(seen, expected, strict=True):
        acted, state = policy.predict(observation, state="kept")
        assert world.action_space.contains(acted)
        np.testing.assert_allclose(acted, action, rtol=1e-6)
        assert state == "kept"
        assert world.action_space.contains(policy.predict(observation, deterministic=False)[0])
    assert len(np.unique(expected, axis=0)) > 1


def stacked(space: gymnasium.Space, seen: list[Any]) -> Any:
    if isinstance(space, Dict):
        return {key: np.stack([observation[key] for observation in seen]) for key in space.spaces}
    if isinstance(space, Tuple):
        return tuple(np.stack([observation[i] for observation in seen]) for i in range(len(space.spaces)))
    return np.stack(seen)


@pytest.mark.parametrize("kind", WORLDS)
def test_a_batch_is_answered_row_by_row(kind):
    observed, taken = WORLDS[kind]
    policy = SymbolicPolicy(tree_for(observed, taken), World(observed, taken))
    seen = [observed.sample() for _ in range(12)]
    one_by_one = np.array([policy.predict(observation)[0] for observation in seen])
    actions, _ = policy.predict(stacked(observed, seen))
    np.testing.assert_array_equal(actions, one_by_one)
    assert actions.dtype == taken.dtype
    in_rows = stacked(observed, [stacked(observed, seen[:6]), stacked(observed, seen[6:])])
    np.testing.assert_array_equal(policy.predict(in_rows)[0].reshape(one_by_one.shape), one_by_one)


@pytest.mark.parametrize("kind", ACTIONS)
def test_without_an_environment_rows_of_numbers_are_answered(kind):
    rng = np.random.default_rng(2)
    tree = random_tree(rng, ACTIONS[kind])
    x = telling_observations(tree, rng, 500)
    policy = SymbolicPolicy(tree)
    np.testing.assert_array_equal(policy.predict(x)[0], tree.predict(x))
    np.testing.assert_array_equal(policy.predict(x[0])[0], tree.predict(x[0]))
    np.testing.assert_array_equal(
        policy.predict(x.reshape(5, 100, 3))[0].reshape(tree.predict(x).shape), tree.predict(x)
    )
    with pytest.raises(ValueError, match="expected observations of shape"):
        policy.predict(x[:, :2])
    with pytest.raises(ValueError, match="expected observations of shape"):
        policy.predict(1.0)


def test_what_is_drawn_has_the_leaf_s_chances_and_a_seed():
    tree = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.log([[0.2, 0.8]]), actions=DiscreteActions(2), feature_names=["x"]
    )
    drawn = [
        SymbolicPolicy(tree, seed=seed).predict(np.zeros((4000, 1)), deterministic=False)[0]
        for seed in (1, 1, 2)
    ]
    assert (drawn[0] == drawn[1]).all()
    assert (drawn[0] != drawn[2]).any()
    assert abs(drawn[0].mean() - 0.8) < 0.03


def test_a_tree_is_read_from_a_file_and_from_a_run(tmp_path):
    tree = tree_for(*WORLDS["box"])
    (tmp_path / "policy.json").write_text(tree.to_json(), encoding="utf-8")
    assert SymbolicPolicy(tmp_path).tree == SymbolicPolicy(str(tmp_path / "policy.json")).tree == tree
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ValueError, match=r"other\.json holds no tree: not a tree of sympol"):
        SymbolicPolicy(tmp_path / "other.json")
    with pytest.raises(FileNotFoundError):
        SymbolicPolicy(tmp_path / "nothing.json")


def test_a_tree_of_another_environment_is_refused():
    tree = tree_for(Box(-1, 1, (4,)), Discrete(3))
    with pytest.raises(ValueError, match=r"sees 4 features .* the environment shows 6: \['cos"):
        SymbolicPolicy(tree, "Acrobot-v1")
    with pytest.raises(ValueError, match=r"actions are DiscreteActions\(n=3.* takes Discrete\(2\)"):
        SymbolicPolicy(tree, "CartPole-v1")
    with pytest.raises(ValueError, match="takes Box"):
        SymbolicPolicy(tree, World(Box(-1, 1, (4,)), Box(-1, 1, (3,))))
    with pytest.raises(TypeError, match="env must be an id, an EnvSpec or something with"):
        SymbolicPolicy(tree, 3)


def test_it_acts_on_an_id_a_spec_an_environment_and_a_vector_of_them(cartpole_tree):
    vector = gymnasium.make_vec("CartPole-v1", num_envs=3, vectorization_mode="sync")
    x, _ = vector.reset(seed=0)
    envs: list[Any] = ["CartPole-v1", sympol.resolve("CartPole-v1"), gymnasium.make("CartPole-v1"), vector]
    for env in envs:
        actions, _ = SymbolicPolicy(cartpole_tree, env).predict(x)
        np.testing.assert_array_equal(actions, cartpole_tree.predict(x))
    vector.close()
    ours = evaluate_policy(SymbolicPolicy(cartpole_tree, "CartPole-v1"), "CartPole-v1", 3)
    assert ours == evaluate_policy(cartpole_tree, "CartPole-v1", 3)


@pytest.fixture
def cartpole_tree() -> DecisionTree:
    """Balances for some hundreds of steps: follow the pole."""
    return DecisionTree.from_complete(
        np.array([3, 2, 2]),
        np.array([-0.05, 0.05, -0.05]),
        np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]),
        actions=DiscreteActions(2, ("push left", "push right")),
        feature_names=["cart position", "cart velocity", "pole angle", "pole angular velocity"],
    )


def test_decisions_are_recorded(cartpole_tree):
    env = RecordDecisions(gymnasium.make("CartPole-v1"), cartpole_tree)
    with pytest.raises(RuntimeError, match="call reset"):
        env.step()
    x, _ = env.reset(seed=3)
    rules = cartpole_tree.rules()
    for _ in range(20):
        ahead = env.decision
        after, _, terminated, _, info = env.step()
        decision = info["decision"]
        assert decision == ahead
        assert decision["leaf"] == cartpole_tree.apply(x)
        assert decision["action"] == cartpole_tree.predict(x)
        assert decision["rule"] in rules
        assert decision["rule"].endswith(f": push {('left', 'right')[decision['action']]}.")
        assert not decision["overridden"]
        x = after
        assert not terminated
    before = env.decision
    assert env.step(before["action"])[4]["decision"] == before
    before = env.decision
    *_, info = env.step(1 - before["action"])
    assert info["decision"] == {**before, "overridden": True}


def test_a_wrapped_environment_plays_as_the_tree_does(cartpole_tree):
    env = RecordDecisions(gymnasium.make("CartPole-v1"), cartpole_tree)
    plain = gymnasium.make("CartPole-v1")
    x, _ = plain.reset(seed=5)
    env.reset(seed=5)
    ended = False
    while not ended:
        x, reward, terminated, truncated, _ = plain.step(int(cartpole_tree.predict(x)))
        seen, got, *ends, _ = env.step()
        np.testing.assert_array_equal(seen, x)
        assert (got, ends) == (reward, [terminated, truncated])
        ended = terminated or truncated


@pytest.mark.parametrize("kind", WORLDS)
def test_decisions_are_recorded_in_any_world(kind):
    env = RecordDecisions(World(*WORLDS[kind]), tree_for(*WORLDS[kind]))
    _, info = env.reset(seed=0)
    assert info == {"fresh": True}
    *_, truncated, info = env.step()
    assert info["steps"] == 1
    assert info["decision"]["rule"].startswith(("If ", "Always"))
    assert not truncated


def test_stable_baselines3_evaluates_it(cartpole_tree, recwarn):
    evaluation = pytest.importorskip("stable_baselines3.common.evaluation")
    sys.modules["torch"].set_num_threads(1)
    env_util = sys.modules.get("stable_baselines3.common.env_util") or pytest.importorskip(
        "stable_baselines3.common.env_util"
    )
    envs = env_util.make_vec_env("CartPole-v1", 3, seed=0)
    policy = SymbolicPolicy(cartpole_tree, envs)
    returns, lengths = evaluation.evaluate_policy(policy, envs, 6, return_episode_rewards=True)
    assert returns == lengths
    assert np.mean(returns) > 100
    world = World(*WORLDS["dict"])
    monitored = sys.modules["stable_baselines3.common.monitor"].Monitor(world)
    mean, _ = evaluation.evaluate_policy(SymbolicPolicy(tree_for(*WORLDS["dict"]), monitored), monitored, 4)
    assert mean == 5


def test_it_is_at_hand():
    assert sympol.SymbolicPolicy is SymbolicPolicy
    assert sympol.RecordDecisions is RecordDecisions
