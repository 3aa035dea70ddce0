"""What is reported is measured on episodes that nothing else has seen."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.algorithms.initialization import host_seed
from sympol.envs.diagnostics import EpisodesCut, SameEpisodes
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.host_envs import HostEnvs
from sympol.envs.registry import resolve
from sympol.envs.spaces import Features
from sympol.play import MAX_EPISODE_STEPS, episode_seed, play, sample_actions
from sympol.search.evaluators import make_evaluator
from sympol.trees import BoxActions, DecisionTree, DiscreteActions

from .tiny import Chain, trained

BALANCE = DecisionTree.from_complete(
    np.array([3]), np.array([0.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]), actions=DiscreteActions(2),
    feature_low=np.full(4, -np.inf),
)  # fmt: skip


class OneByOne:
    """What stable-baselines3's models look like from outside."""

    def __init__(self, tree: DecisionTree = BALANCE):
        self.tree = tree

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ):
        assert deterministic
        return self.tree.predict(observation), None


def test_a_tree_and_anything_with_predict_play_the_same_episodes():
    many = sympol.evaluate_policy(BALANCE, "CartPole-v1", 5, seed=3, return_episode_rewards=True)
    single = sympol.evaluate_policy(OneByOne(), "CartPole-v1", 5, seed=3, return_episode_rewards=True)
    assert many == single
    assert many[0] == [float(length) for length in many[1]]
    mean, std = sympol.evaluate_policy(BALANCE, "CartPole-v1", 5, seed=3)
    assert (mean, std) == (np.mean(many[0]), np.std(many[0]))


def test_an_id_an_object_and_a_factory_are_played_alike():
    def make() -> gymnasium.Env:
        return gymnasium.make("CartPole-v1")

    results = [sympol.evaluate_policy(BALANCE, env, 4) for env in ("CartPole-v1", make, make())]
    assert results[0] == results[1] == results[2]
    alone = gymnasium.wrappers.TimeLimit(gymnasium.make("CartPole-v1").unwrapped, 500)
    alone.unwrapped.spec = None
    assert sympol.evaluate_policy(BALANCE, alone, 4) == results[0]
    alone.reset()  # the user's own object is still open


def test_a_seed_repeats_its_episodes_and_another_brings_others():
    def returns(seed: int, *, deterministic: bool = True) -> list[float]:
        arguments = {"seed": seed, "deterministic": deterministic, "return_episode_rewards": True}
        return sympol.evaluate_policy(BALANCE, "CartPole-v1", 8, **arguments)[0]

    assert returns(0) == returns(0) != returns(1)
    assert returns(0, deterministic=False) == returns(0, deterministic=False) != returns(0)


def test_training_validation_and_test_share_no_seed():
    """Of 50 runs: all test episodes of seeds 0 to 49, and all resets of all copies at 21 timesteps."""
    features = Features.of(Box(-1, 1, (2,)))
    test = {episode_seed(seed, episode) for seed in range(50) for episode in range(200)}
    given: dict[str, set[int]] = {"train": set(), "validation": set()}
    envs = [Chain(Box(-1, 1, (2,)), Discrete(2)) for _ in range(8)]
    left = iter(envs)
    host = HostEnvs(lambda: next(left), 8, features, Discrete(2))
    for seed in range(50):
        for purpose, timesteps in (("train", range(0, 10_500, 500)), ("validation", (0,))):
            for timestep in timesteps:
                host.reset(host_seed(seed, purpose, timestep))
                given[purpose] |= {env.seeds[-1] for env in envs}  # pyright: ignore
    assert len(test) == 50 * 200
    assert len(given["train"]) == 50 * 21 * 8
    assert len(given["validation"]) == 50 * 8
    assert not test & given["train"]
    assert not test & given["validation"]
    assert not given["train"] & given["validation"]
    # not by luck: the ones are odd, the others even
    assert {seed % 2 for seed in test} == {1}
    assert {seed % 2 for seed in given["train"] | given["validation"]} == {0}


def test_purposes_share_no_episode_with_tests():
    seeds = {
        purpose: {episode_seed(seed, episode, purpose) for seed in range(50) for episode in range(200)}
        for purpose in ("test", "validation", "distill")
    }
    assert all(len(of_one) > 9_990 for of_one in seeds.values())  # of 2³¹: hardly any met by chance
    assert not seeds["test"] & (seeds["validation"] | seeds["distill"])
    assert len(seeds["validation"] & seeds["distill"]) < 10


class Endless(gymnasium.Env):
    observation_space, action_space = Box(-1, 1, (1,)), Discrete(2)

    def reset(self, *, seed=None, options=None):
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 1.0, False, False, {}


def test_an_episode_without_end_is_cut():
    tree = DecisionTree.from_complete(np.zeros(0, int), np.zeros(0), np.eye(2)[:1], actions=DiscreteActions(2),
                                      feature_names=["x"])  # fmt: skip
    with pytest.warns(EpisodesCut, match="did not end an episode within 10,000 steps, so evaluation cuts"):
        assert sympol.evaluate_policy(tree, Endless, 1) == (MAX_EPISODE_STEPS, 0)


class Ports(gymnasium.Env):
    """Needs one of eight ports, and says how many were taken at once. How an episode goes depends on its seed alone."""

    observation_space, action_space = Box(-np.inf, np.inf, (2,)), Discrete(2)
    ports, open, most, fails_at = 8, 0, 0, 0

    def __init__(self):
        if Ports.open >= Ports.ports:
            raise RuntimeError("no free port")
        Ports.open += 1
        Ports.most = max(Ports.most, Ports.open)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.time, self.length = 0, int(self.np_random.integers(3, 30))
        return self.np_random.normal(size=2).astype(np.float32), {}

    def step(self, action):
        self.time += 1
        if self.time == Ports.fails_at:
            raise RuntimeError("out of order")
        seen, ended = self.np_random.normal(size=2).astype(np.float32), self.time >= self.length
        return seen, float(action * self.np_random.normal()), ended, False, {}

    def close(self):
        Ports.open -= 1


@pytest.fixture
def ports(monkeypatch) -> type[Ports]:
    for name, value in (("ports", 8), ("open", 0), ("most", 0), ("fails_at", 0)):
        monkeypatch.setattr(Ports, name, value)
    return Ports


SIGN = DecisionTree.from_complete(
    np.array([0]), np.array([0.0]), np.array([[1.0, -1.0], [-1.0, 1.0]]), actions=DiscreteActions(2),
    feature_low=np.full(2, -np.inf),
)  # fmt: skip


def one_after_the_other(num_episodes: int) -> tuple[list[float], list[int], list[np.ndarray]]:
    """What `SIGN` earns, by Gymnasium's own loop, and all observations acted on, step by step."""
    env, returns, seen = Ports(), [], []
    for episode in range(num_episodes):
        x, done, total = env.reset(seed=episode_seed(0, episode))[0], False, 0.0
        observed = []
        while not done:
            observed.append(x)
            x, reward, done, _, _ = env.step(int(SIGN.predict(x)))
            total += reward
        returns.append(total)
        seen.append(observed)
    env.close()
    lengths = [len(observed) for observed in seen]
    return (
        returns,
        lengths,
        [observed[t] for t in range(max(lengths)) for observed in seen if t < len(observed)],
    )


@pytest.mark.parametrize("num_ports", [1, 3, 8, 100])
def test_episodes_are_the_same_on_however_many_copies_can_be_open(ports, num_ports):
    returns, lengths, seen = one_after_the_other(40)
    ports.ports = num_ports
    played = play(SIGN, resolve(Ports), 40, seed=0)
    assert (played.returns.tolist(), played.lengths.tolist()) == (returns, lengths)
    np.testing.assert_array_equal(played.observations, np.stack(seen))
    assert (ports.open, ports.most) == (0, min(num_ports, 16))
    assert sympol.evaluate_policy(SIGN, Ports, 40, return_episode_rewards=True) == (returns, lengths)


def test_an_agent_is_evaluated_on_no_more_copies_than_it_was_trained_on(ports, tmp_path):
    agent = trained(Ports, num_envs=2, depth=1)
    assert (ports.open, ports.most) == (0, 4)  # two to train on, two to validate on meanwhile
    ports.most = 0
    sympol.evaluate_policy(agent, Ports, 20)
    sympol.evaluate_policy(agent, agent.spec, 20, deterministic=False)
    play(agent.tree(), agent.spec, 20, seed=0)
    agent.save(tmp_path / "run")
    loaded = sympol.load(tmp_path / "run", env=Ports)
    sympol.distill_policy(loaded, "dagger", 1, num_iterations=2, episodes_per_iteration=5)
    make_evaluator(agent.spec, 0).play([agent.tree()], range(40))
    assert (ports.open, ports.most) == (0, 2)


def test_a_search_for_a_smaller_tree_takes_no_more_copies_than_the_training(ports):
    ports.ports = 1
    trained(Ports, num_envs=1, total_timesteps=1024, max_nodes=3, depth=3)
    assert (ports.open, ports.most) == (0, 1)


@pytest.mark.parametrize("policy", [SIGN, OneByOne(SIGN)])
def test_environments_are_closed_where_one_fails(ports, policy):
    ports.fails_at = 2
    with pytest.raises(Exception, match="out of order"):
        sympol.evaluate_policy(policy, Ports, 4)
    assert ports.open == 0


def test_a_training_that_wants_too_many_copies_is_refused_and_closes_those_it_made(ports):
    with pytest.raises(
        EnvironmentFailure, match=r"num_envs must be at most 8, .* RuntimeError: no free port"
    ):
        trained(Ports, num_envs=10, total_timesteps=4096)
    assert ports.open == 0


def test_an_object_plays_all_episodes_itself_and_stays_open(ports):
    returns, lengths, _ = one_after_the_other(20)
    env = Ports()
    assert sympol.evaluate_policy(SIGN, env, 20, return_episode_rewards=True) == (returns, lengths)
    assert (ports.open, ports.most) == (1, 1)


class Fixed(gymnasium.Env):
    """The same episode again and again, its seed ignored."""

    observation_space, action_space = Box(-1, 1, (4,)), Discrete(2)

    def reset(self, *, seed=None, options=None):
        self.time = 0
        return np.zeros(4, np.float32), {}

    def step(self, action):
        self.time += 1
        return np.full(4, self.time / 4, np.float32), 1.0, self.time >= 4, False, {}


@pytest.mark.parametrize("policy", [BALANCE, OneByOne()])
def test_episodes_that_are_all_the_same_are_warned_of(policy):
    with pytest.warns(
        SameEpisodes, match="the 5 test episodes on Fixed are all the same, whatever their seed"
    ):
        assert sympol.evaluate_policy(policy, Fixed, 5) == (4, 0)
    sympol.evaluate_policy(policy, Fixed, 4)  # that few may be so by chance
    short = lambda: gymnasium.wrappers.TimeLimit(gymnasium.make("CartPole-v1").unwrapped, 5)  # noqa: E731
    assert sympol.evaluate_policy(policy, short, 10) == (5, 0)  # as good, but not the same


def test_sampling_draws_from_the_leaf_s_distribution():
    x, rng = np.zeros((20_000, 4)), np.random.default_rng(0)
    chance = BALANCE.predict_proba(x)[0, 1]
    assert abs(sample_actions(BALANCE, x, rng).mean() - chance) < 0.01
    gauss = DecisionTree.from_complete(
        np.zeros(0, int), np.zeros(0), np.array([[0.5]]), feature_names=["x"],
        actions=BoxActions((-10.0,), (10.0,), (1,), std=(0.25,)),
    )  # fmt: skip
    drawn = sample_actions(gauss, x[:, :1], rng)
    assert (abs(drawn.mean() - 0.5) < 0.01, abs(drawn.std() - 0.25) < 0.01) == (True, True)


def test_the_observations_acted_on_are_reported():
    spec = resolve("CartPole-v1", backend="host")
    episodes = play(BALANCE, spec, 3, seed=0)
    assert episodes.observations.shape == (int(episodes.lengths.sum()), 4)
    assert BALANCE.with_visits(episodes.observations).n_node_samples[0] == episodes.lengths.sum()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_eval_episodes": 0}, "n_eval_episodes must be at least 1, got 0"),
        ({"seed": -1}, "seed must not be negative, got -1"),
        ({"env": "CartPoel-v1"}, "did you mean 'CartPole-v1'"),
        ({"env": "Pendulum-v1"}, r"expected observations of shape \[4\]"),
    ],
)
def test_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        sympol.evaluate_policy(BALANCE, **{"env": "CartPole-v1", **arguments})
