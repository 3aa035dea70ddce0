"""The user's verbs: learn, predict, tree, save, load."""

from __future__ import annotations

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiBinary, MultiDiscrete, Tuple

import sympol
from sympol.agents import Report
from sympol.algorithms.config import ConfigError
from sympol.envs.errors import EnvironmentFailure, UnknownEnvironment
from sympol.runs.metadata import RunError
from sympol.trees import BoxActions, DiscreteActions, MultiDiscreteActions

from .envs.probes import MultiDiscreteMatch
from .tiny import COLUMNS, NAMES, TINY, Chain, agent, quick_compiles, trained

__all__ = ["quick_compiles"]

X = np.random.default_rng(0).normal(size=(50, 4)).astype(np.float32)


@pytest.fixture(scope="module")
def cartpole() -> sympol.PPO:
    return trained()


def test_learn_returns_the_agent_and_trains_for_all_steps(cartpole):
    assert isinstance(cartpole, sympol.PPO)
    assert cartpole.num_timesteps >= TINY["total_timesteps"]
    assert cartpole.state is not None


def test_there_is_no_tree_before_learning():
    new = agent()
    with pytest.raises(RuntimeError, match=r"call learn\(\) first"):
        new.tree()
    with pytest.raises(RuntimeError, match=r"call learn\(\) first"):
        new.predict(np.zeros(4))
    assert new.num_timesteps == 0


def test_the_tree_is_pruned_unless_asked(cartpole):
    full, tree = cartpole.tree(prune=False), cartpole.tree()
    assert full.n_leaves == 2 ** TINY["depth"]
    assert tree.n_nodes <= full.n_nodes
    assert tree == full.prune() == cartpole.tree()
    assert (tree.predict(X) == full.predict(X)).all()


def test_predict_one_and_many(cartpole):
    one, state = cartpole.predict(X[0])
    many, _ = cartpole.predict(X)
    assert state is None
    assert np.ndim(one) == 0
    assert one in {0, 1}  # can be looked up, as FrozenLake does
    assert many.shape == (50,)
    assert one == many[0]
    assert (many == cartpole.tree().predict(X)).all()
    assert all(gymnasium.spaces.Discrete(2).contains(action) for action in many)


def test_predict_can_sample(cartpole):
    many = [cartpole.predict(X, deterministic=False)[0] for _ in range(20)]
    assert {0, 1} == {int(action) for action in np.ravel(many)}
    assert np.ndim(cartpole.predict(X[0], deterministic=False)[0]) == 0
    chances = cartpole.tree(prune=False).predict_proba(X)[:, 1]
    assert abs(np.mean(many) - chances.mean()) < 0.05


@pytest.mark.parametrize(
    "observation",
    [
        np.zeros(3),
        np.zeros((2, 5)),
        0.5,
        "left",
        [None] * 4,
        {"x": 1},
        np.zeros(4, complex),
        [[0.0], [1.0, 2.0]],
    ],
)
def test_predict_refuses_what_is_no_observation(cartpole, observation):
    with pytest.raises(ValueError, match=r"observation must be an array of real numbers of shape \(4,\)"):
        cartpole.predict(observation)


def test_the_same_seed_gives_the_same_tree_and_another_one_another(cartpole):
    again, other = trained(), trained(seed=1)
    assert again.tree(prune=False) == cartpole.tree(prune=False)
    assert other.tree(prune=False) != cartpole.tree(prune=False)


def test_callbacks_are_told_in_order_and_can_stop(cartpole):
    heard: list[tuple[str, int]] = []
    reports: list[Report] = []

    def first(report: Report) -> None:
        heard.append(("first", report.timestep))
        reports.append(report)

    def second(report: Report) -> bool:
        heard.append(("second", report.timestep))
        return report.timestep < 700

    stopped = agent()
    assert stopped.learn(callback=[first, second], progress_bar=False) is stopped
    assert [who for who, _ in heard] == ["first", "second"] * len(reports)
    assert stopped.num_timesteps == reports[-1].timestep >= 700 > reports[-2].timestep
    for report in reports:
        assert report.agent is stopped
        assert report.total_timesteps == TINY["total_timesteps"]
        assert tuple(report.metrics) == COLUMNS
        assert report.metrics["time/total_timesteps"] == report.timestep

    stopped.learn(callback=first, progress_bar=False)
    assert stopped.num_timesteps == cartpole.num_timesteps
    assert stopped.tree(prune=False) == cartpole.tree(prune=False)


def test_a_callback_that_raises_leaves_the_agent_able_to_go_on(cartpole):
    def trouble(report: Report) -> None:
        raise RuntimeError("disk full")

    broken = agent()
    with pytest.raises(RuntimeError, match="disk full"):
        broken.learn(callback=trouble, progress_bar=False)
    assert broken.num_timesteps > 0
    assert broken.learn(progress_bar=False).tree(prune=False) == cartpole.tree(prune=False)


def test_learning_ends(cartpole):
    with pytest.raises(ValueError, match=r"trained for all its 2048 steps; make a new one"):
        cartpole.learn(progress_bar=False)


def test_the_length_is_chosen_once():
    stopped = agent(total_timesteps=4096)
    stopped.learn(2048, callback=lambda report: False, progress_bar=False)
    assert stopped.config.total_timesteps == 2048
    with pytest.raises(ValueError, match=r"cannot become 9999 after \d+ steps"):
        stopped.learn(9999, progress_bar=False)
    with pytest.raises(ConfigError, match=r"total_timesteps must cover one rollout of 16 steps"):
        agent().learn(10)


def test_the_progress_bar_can_be_silent(capfd):
    agent().learn(callback=lambda report: False, progress_bar=False)
    assert capfd.readouterr() == ("", "")
    agent().learn(callback=[lambda report: False], progress_bar=True)
    said = capfd.readouterr()
    assert said.out == ""
    assert "training" in said.err


def test_save_and_load(cartpole, tmp_path):
    cartpole.save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert again.tree(prune=False) == cartpole.tree(prune=False)
    assert (again.predict(X)[0] == cartpole.predict(X)[0]).all()
    assert (again.config, again.seed, again.spec.name) == (cartpole.config, 0, "CartPole-v1")
    again.save(str(tmp_path / "run"))  # in place
    assert sympol.load(tmp_path / "run").tree() == cartpole.tree()


def test_a_saved_agent_goes_on_where_it_was(cartpole, tmp_path):
    stopped = agent()
    stopped.learn(callback=lambda report: report.timestep < 1000, progress_bar=False)
    stopped.save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert again.num_timesteps == stopped.num_timesteps
    assert again.learn(progress_bar=False).tree(prune=False) == cartpole.tree(prune=False)


def test_an_untrained_agent_is_saved_untrained(tmp_path):
    agent(seed=3).save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert (again.num_timesteps, again.seed) == (0, 3)


def test_loading_changes_nothing_in_the_folder(cartpole, tmp_path):
    cartpole.save(tmp_path)
    (tmp_path / "metrics.csv").write_bytes(
        b",".join(c.encode() for c in COLUMNS) + b"\r\n9999,1,1,1,1,1,1,1,1,1,1\r\n"
    )
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    sympol.load(tmp_path)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def test_save_leaves_strangers_alone(cartpole, tmp_path):
    (tmp_path / "config.toml").write_text('[package]\nname = "somebody else\'s"\n')
    with pytest.raises(RunError, match="not a sympol run"):
        cartpole.save(tmp_path)
    assert (tmp_path / "config.toml").read_text().startswith("[package]")
    mine = tmp_path / "run"
    cartpole.save(mine)
    (mine / "notes.md").write_text("keep me")
    cartpole.save(mine)
    assert (mine / "notes.md").read_text() == "keep me"


def test_the_user_s_names_are_everywhere(tmp_path):
    named = agent(feature_names=NAMES, action_names=("go", "stay"))
    named.learn(callback=lambda report: False, progress_bar=False)
    named.save(tmp_path)
    again = sympol.load(tmp_path)
    for tree in (named.tree(), named.tree(prune=False), again.tree()):
        assert tree.feature_names == NAMES
        assert tree.actions == DiscreteActions(2, ("go", "stay"))
    asked = [name for name, f in zip(NAMES, range(4), strict=True) if f in named.tree().feature]
    for file in ("policy.json", "policy.py", "config.toml"):
        assert all(name in (tmp_path / file).read_text() for name in NAMES), file
    for file in ("tree.txt", "tree.svg"):
        assert all(name in (tmp_path / file).read_text() for name in asked), file
        assert "stay" in (tmp_path / file).read_text() or "go" in (tmp_path / file).read_text()


@pytest.mark.parametrize(
    ("arguments", "options", "error", "message"),
    [
        (("forest", "CartPole-v1"), {}, ConfigError, "policy must be one of tree, mlp, sdt, got 'forest'"),
        (("mlp", "CartPole-v1"), {"depth": 3}, ConfigError, "depth belongs to tree and sdt; mlp has none"),
        (("tree", "CartPoel-v1"), {}, UnknownEnvironment, "did you mean 'CartPole-v1'"),
        (("tree", "CartPole-v1"), {"seed": -1}, ValueError, "seed must be a whole number"),
        (("tree", "CartPole-v1"), {"seed": 1.5}, ValueError, "seed must be a whole number"),
        (("tree", "CartPole-v1"), {"depth": 15}, ConfigError, r"depth must be between 1 and 14, got 15"),
        (
            ("tree", "CartPole-v1"),
            {"detph": 5},
            ConfigError,
            "unknown config field 'detph'; did you mean depth",
        ),
        (("tree", "CartPole-v1"), {"gamma": float("nan")}, ConfigError, "gamma must be a number, got nan"),
        (
            ("tree", "CartPole-v1"),
            {"preset": "nope"},
            ConfigError,
            "no preset 'nope' for ppo with tree; it has ",
        ),
        (("tree", "CartPole-v1"), {"feature_names": ["a"]}, ValueError, "must have 4 names, got 1"),
        (("tree", "CartPole-v1"), {"action_names": ["a", "a"]}, ValueError, "must differ from each other"),
        (("tree", 42), {}, TypeError, "env must be an id"),
        (
            ("tree", Chain(gymnasium.spaces.Text(3), Discrete(2))),
            {},
            ValueError,
            "unsupported observation space",
        ),
        (("tree", Chain(Box(0, 1), MultiBinary(2))), {}, ValueError, "unsupported action space"),
    ],
)
def test_bad_input_is_said_before_any_work(arguments, options, error, message):
    with pytest.raises(error, match=message):
        sympol.PPO(*arguments, **options)


BOX = Box(np.float32([-1, -np.inf]), np.float32([1, np.inf]))
SPACES = {
    "dict, discrete from 5": (
        Dict(box=BOX, mode=Discrete(3, start=7), lights=MultiBinary(2)),
        Discrete(3, start=5),
        DiscreteActions,
    ),
    "tuple, multi-discrete": (
        Tuple((MultiDiscrete([2, 3]), Discrete(2), BOX)),
        MultiDiscrete([2, 3], start=[1, -4]),
        MultiDiscreteActions,
    ),
    "discrete, box": (
        Discrete(4, start=-1),
        Box(np.array([[-0.1], [-2]]), np.array([[0.1], [0.7]]), dtype=np.float64),  # no float32 is 0.1
        BoxActions,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SPACES)
def test_every_space(kind, tmp_path):
    observed, acted, actions = SPACES[kind]
    one = trained(lambda: Chain(observed, acted), total_timesteps=256, num_evals=2)
    tree = one.tree()
    assert isinstance(tree.actions, actions)
    assert tree.n_features == gymnasium.spaces.flatdim(observed)
    for _ in range(20):
        observation = observed.sample()
        action, _ = one.predict(observation)
        assert acted.contains(action if np.ndim(action) else action[()])
        flat = gymnasium.spaces.flatten(observed, observation)
        assert np.array_equal(action, tree.predict(np.float32(flat)))
        sampled = one.predict(observation, deterministic=False)[0]
        assert acted.contains(sampled if np.ndim(sampled) else sampled[()])
    many = gymnasium.vector.utils.batch_space(observed, 5).sample()
    assert len(one.predict(many)[0]) == 5
    assert (
        len(sympol.evaluate_policy(one, lambda: Chain(observed, acted), 3, return_episode_rewards=True)[0])
        == 3
    )

    one.save(tmp_path)
    with pytest.raises(RunError, match=r"give the environment itself: sympol.load\(path, env=...\)"):
        sympol.load(tmp_path)
    again = sympol.load(tmp_path, env=lambda: Chain(observed, acted))
    assert again.tree(prune=False) == one.tree(prune=False)


def test_an_environment_in_jax_of_one_s_own(tmp_path):
    env = MultiDiscreteMatch()
    one = trained(env, feature_names=("first sign", "second sign"), total_timesteps=2048)
    assert one.spec.env is env
    for observation, action in (([-1, -1], [0, 0]), ([1, -1], [1, 0]), ([-1, 1], [0, 2]), ([1, 1], [1, 2])):
        assert one.predict(np.float32(observation))[0].shape == np.shape(action)
    assert sympol.evaluate_policy(one, env) == sympol.evaluate_policy(one, one.spec)
    sympol.register("Signs-v0", env)
    by_id = sympol.PPO("tree", "Signs-v0", feature_names=("first sign", "second sign"), **TINY)
    assert by_id.learn(progress_bar=False).tree(prune=False) == one.tree(prune=False)
    by_id.save(tmp_path)
    assert sympol.load(tmp_path).tree() == by_id.tree()


@pytest.fixture(scope="module")
def on_host() -> sympol.PPO:
    return trained(backend="host")


def test_on_the_host_a_stopped_training_goes_on_to_the_same_tree(on_host, tmp_path):
    stopped = agent(backend="host")
    stopped.learn(callback=lambda report: report.timestep < 1000, progress_bar=False)
    stopped.save(tmp_path)
    assert sympol.load(tmp_path).learn(progress_bar=False).tree(prune=False) == on_host.tree(prune=False)
    assert stopped.learn(progress_bar=False).tree(prune=False) == on_host.tree(prune=False)


def test_an_object_a_factory_and_an_id_are_the_same_environment(on_host):
    import gymnasium.envs.classic_control as classic

    def make() -> gymnasium.Env:
        return gymnasium.make("CartPole-v1")

    names = on_host.tree().feature_names
    for env in (make, make()):
        one = trained(env, feature_names=names, action_names=("push left", "push right"))
        assert one.tree(prune=False) == on_host.tree(prune=False)
    single = agent(classic.CartPoleEnv(), num_envs=1, total_timesteps=1024)
    assert single.spec.has_one_copy
    with pytest.raises(ValueError, match="num_envs must be 1, got 4"):
        agent(classic.CartPoleEnv()).learn()


class Troubled(gymnasium.Wrapper):
    """CartPole, in trouble at one step of its life."""

    trouble: str | None = None
    at = 150

    def __init__(self) -> None:
        super().__init__(gymnasium.make("CartPole-v1").unwrapped)
        self.env = gymnasium.wrappers.TimeLimit(self.env, 500)
        self.lived = 0

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        self.lived += 1
        if self.lived == self.at and self.trouble == "raises":
            raise ZeroDivisionError("the pole broke")
        if self.lived == self.at and self.trouble == "nan observation":
            observation = observation * np.float32(np.nan)
        if self.lived == self.at and self.trouble == "inf reward":
            reward = np.inf
        return observation, reward, terminated, truncated, info


@pytest.mark.parametrize("trouble", ["raises", "nan observation", "inf reward"])
def test_an_environment_that_fails_loses_nothing(trouble, monkeypatch):
    monkeypatch.setattr(Troubled, "trouble", trouble)
    one = agent(Troubled)
    with pytest.raises(
        EnvironmentFailure, match=r"at training step [\d,]+.*: environment \d+ (failed|returned)"
    ):
        one.learn(progress_bar=False)
    assert 0 < one.num_timesteps < 2048
    one.tree()
    monkeypatch.setattr(Troubled, "trouble", None)
    one.learn(progress_bar=False)
    assert one.num_timesteps >= 2048
    assert np.isfinite(float(one.state.validation.last_return))


def test_a_training_that_comes_to_nan_says_where_and_keeps_what_it_had():
    one = agent(learning_rate_critic=10.0, learning_rate_leaf_values=10.0, reward_scale=1e9)
    state = agent().learn(callback=lambda report: False, progress_bar=False).state
    broken = jax.tree.map(lambda a: a * np.float32(np.nan) if a.dtype == np.float32 else a, state.networks)

    class Poisoned:
        latest = None

        def advance(self, before, stop):
            return state._replace(networks=broken)

    class Bar:
        def update(self, metrics): ...

    with pytest.raises(
        EnvironmentFailure, match=r"between training steps 0 and \d+ the training came to NaN"
    ):
        one._learn(Poisoned(), [], Bar())
    assert one.state is None
