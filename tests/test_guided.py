"""The training of a tree with a teacher: one clock, resumed to the bit, never worse than said."""

import json

import gymnasium
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.algorithms.config import Config, ConfigError
from sympol.algorithms.on_policy import coefficients
from sympol.algorithms.recipe import FEWEST, recipe
from sympol.algorithms.teaching import TEACHING, teacher_config
from sympol.distill import Teacher
from sympol.distill.dataset import Limits
from sympol.distill.within_steps import _sizes, _smallest, distill_within
from sympol.envs.errors import EnvironmentFailure
from sympol.envs.registry import resolve
from sympol.policies.mlp import MLP
from sympol.policies.tree import Tree
from tests.tiny import TINY, flags, status_of

AUTO = {**TINY, "method": "auto", "total_timesteps": 4096, "critic_hidden": (8, 8)}


class Ones(gymnasium.Env):
    """Every action earns 1 and nothing changes but the time."""

    observation_space = gymnasium.spaces.Box(0, 8, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)
    opened = 0

    def __init__(self) -> None:
        type(self).opened += 1
        self.t = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.t += 1
        return np.full(1, self.t, np.float32), 1.0, self.t == 8, False, {}


class Target(Ones):
    """The right action is whether the observation is above a half; actions are continuous, from 0 to 10."""

    observation_space = gymnasium.spaces.Box(0, 1, (2,), np.float32)
    action_space = gymnasium.spaces.Box(0, 10, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.seen = self.np_random.random(2, np.float32)
        return self.seen, {}

    def step(self, action):
        reward = -abs(float(action[0]) - (8 if self.seen[1] > 0.5 else 2))
        self.t += 1
        self.seen = self.np_random.random(2, np.float32)
        return self.seen, reward, self.t == 8, False, {}


def auto(env="CartPole-v1", **options):
    return sympol.PPO("tree", env, **{**AUTO, **options})


def stop_at(timestep):
    return lambda report: report.timestep < timestep


@pytest.fixture(scope="module")
def finished():
    seen = []
    agent = auto(seed=3)
    agent.learn(progress_bar=False, callback=lambda report: seen.append((report.timestep, agent.has_tree)))
    return agent, seen


def test_every_step_counts(finished):
    agent, seen = finished
    guide = agent.state.guide
    assert TEACHING * 4096 <= int(guide.teacher_steps) < int(guide.steps) <= agent.num_timesteps
    assert [has_tree for _, has_tree in seen] == [step > int(guide.teacher_steps) for step, _ in seen]
    assert seen[-1] == (agent.num_timesteps, True)
    assert 4096 <= agent.num_timesteps < 4096 + 64 + int(guide.steps)
    assert isinstance(agent.state.networks.actor, Tree)


def test_the_tree_is_the_policy(finished):
    agent, _ = finished
    x = np.random.default_rng(0).normal(size=(500, 4)).astype(np.float32)
    tree = agent.tree()
    np.testing.assert_array_equal(tree.predict(x), agent.predict(x)[0])
    np.testing.assert_array_equal(agent.tree(prune=False).predict(x), tree.predict(x))


def test_before_it_is_distilled_there_is_no_tree(tmp_path):
    agent = auto().learn(progress_bar=False, callback=stop_at(600))
    assert not agent.has_tree
    assert agent.predict(np.zeros(4, np.float32))[0] in (0, 1)
    with pytest.raises(RuntimeError, match="no tree yet after 1024 steps"):
        agent.tree()


@pytest.mark.parametrize("env", ["CartPole-v1", "FrozenLake-v1"])
@pytest.mark.parametrize("timestep", [600, 3500])
def test_resumed_it_is_the_same_to_the_bit(tmp_path, env, timestep):
    whole = auto(env, seed=1).learn(progress_bar=False)
    parted = auto(env, seed=1).learn(progress_bar=False, callback=stop_at(timestep))
    assert parted.num_timesteps < 4096
    parted.save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert again.num_timesteps == parted.num_timesteps
    again.learn(progress_bar=False)
    assert again.tree().to_json() == whole.tree().to_json()
    assert again.num_timesteps == whole.num_timesteps


def test_what_fails_while_a_tree_is_distilled_loses_nothing(monkeypatch):
    def fail(*_, **__):
        raise OSError("the simulator has gone")

    agent = auto(seed=3)
    with monkeypatch.context() as patched:
        patched.setattr("sympol.guided.distill_within", fail)
        with pytest.raises(
            EnvironmentFailure, match=r"distillation, after 2,048 steps .*OSError: the simulator"
        ):
            agent.learn(progress_bar=False)
    assert 0 < agent.num_timesteps < 4096
    agent.learn(progress_bar=False)
    assert agent.has_tree


def test_a_vector_environment_begins_anew_for_the_tree_without_a_warning():
    envs = gymnasium.make_vec("FrozenLake-v1", 4, vectorization_mode="sync")
    agent = auto(envs).learn(progress_bar=False)
    assert agent.has_tree


def test_a_teacher_that_learned_nothing_is_left_out():
    agent = auto(Ones, num_envs=2, num_steps=32).learn(progress_bar=False)
    guide = agent.state.guide
    assert not guide.is_distilled
    assert guide.teacher_return == guide.random_return == 8


def test_continuous_actions_keep_their_unit_and_the_noise_of_the_teacher():
    spec = resolve(Target)
    agent = sympol.PPO("tree", spec, seed=0, num_eval_episodes=10).learn(12_000, progress_bar=False)
    guide = agent.state.guide
    assert guide.is_distilled
    assert guide.random_return < guide.tree_return < 0
    assert agent.state.validation.best_return >= guide.tree_return - 3
    low, high = agent.tree().predict(np.array([[0.5, 0.2], [0.5, 0.8]], np.float32)).ravel()
    assert abs(low - 2) < 1.5
    assert abs(high - 8) < 1.5


def test_the_size_is_limited_from_the_beginning():
    agent = auto(max_nodes=7)
    sizes = []
    agent.learn(
        progress_bar=False,
        callback=lambda report: sizes.append(agent.tree().n_nodes) if agent.has_tree else None,
    )
    assert sizes
    assert max(sizes) <= 7


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"critic": "tree"}, "critic must be mlp with method auto"),
        ({"grow_splits": False}, "with method auto the distilled tree grows, got grow_splits False"),
        ({"max_nodes": 1}, "with method auto the distilled tree grows, got max_nodes 1"),
        ({"policy": "mlp"}, "method belongs to tree"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        Config.from_dict({"method": "auto", "grow_splits": True, **options})


def test_it_cannot_start_from_a_tree(finished):
    with pytest.raises(ConfigError, match="method must be direct"):
        auto(start=finished[0].tree(), grow_splits=True)


def test_the_teacher_needs_a_validation_of_its_own():
    with pytest.raises(ConfigError, match="num_evals must be at least 2"):
        auto(num_evals=1).learn(progress_bar=False)


def test_the_teacher_has_what_belongs_to_the_environment():
    config = auto(Ones, gamma=0.5, reward_scale=3.0, total_timesteps=8000).config
    taught = teacher_config("", config)
    assert (taught.policy, taught.gamma, taught.reward_scale) == ("mlp", 0.5, 3.0)
    assert taught.total_timesteps == 4000


def test_schedules_run_over_the_training_of_the_tree(finished):
    agent, _ = finished
    state, hyper = agent.state, agent.config.hyperparameters()
    entropy, rate = coefficients(agent.config, hyper, state._replace(timestep=state.guide.steps))
    assert (float(entropy), float(rate)) == pytest.approx((agent.config.ent_coef, 1))
    entropy, rate = coefficients(agent.config, hyper, state._replace(timestep=jnp.int32(4096)))
    assert float(entropy) == pytest.approx(-agent.config.ent_coef)
    assert float(rate) == pytest.approx(0.1)


def test_a_critic_computes_the_same_on_another_scale():
    rng = np.random.default_rng(1)
    mlp = MLP(
        tuple(jnp.asarray(rng.normal(size=shape), jnp.float32) for shape in ((3, 5), (5, 1))),
        tuple(jnp.asarray(rng.normal(size=size), jnp.float32) for size in (5, 1)),
    )
    raw = rng.normal(size=(20, 3)).astype(np.float32)
    before, after = ((rng.normal(size=3), rng.uniform(0.1, 9, 3)) for _ in range(2))
    moved = mlp.on_scale(*((jnp.float32(shift), jnp.float32(scale)) for shift, scale in (before, after)))
    inputs = (jnp.float32((raw - shift) * scale) for shift, scale in (before, after))
    expected, found = (net(x) for net, x in zip((mlp, moved), inputs, strict=True))
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("steps", [FEWEST, 20_000, 200_000, 10_000_000])
def test_the_recipe_has_a_teacher_unless_it_is_told_otherwise(steps):
    assert recipe({"total_timesteps": steps})["method"] == "auto"
    for given in ({"method": "direct"}, {"node_price": 1.0}, {"critic": "tree"}, {"max_nodes": 1}):
        assert recipe({"total_timesteps": steps, **given}).get("method", "direct") == "direct"
    assert "method" not in recipe({"total_timesteps": FEWEST - 1})
    assert "method" not in recipe({"total_timesteps": steps}, from_tree=True)


def test_presets_are_trained_directly():
    assert sympol.PPO("tree", "CartPole-v1").config.method == "direct"
    config = sympol.PPO("tree", "CartPole-v1", method="auto").config
    assert config.grow_splits
    assert config.method == "auto"


class TestDistillWithin:
    """A tree of a teacher that is known."""

    spec = resolve("CartPole-v1", backend="host")

    def teacher(self):
        def outputs(x):
            push = x[:, 2] + 0.5 * x[:, 3]
            return np.stack([-push, push], axis=1).astype(np.float32)

        return Teacher.from_outputs(self.spec, outputs)

    def test_it_plays_about_as_many_steps_as_it_may(self):
        found = distill_within(self.teacher(), 10_000, limits=Limits(5, None), seed=0)
        assert found.num_steps <= 12_000
        assert found.teacher_is_better
        assert found.teacher_return > found.random_return
        assert found.tree_return > found.random_return

    def test_the_same_seed_gives_the_same_tree(self):
        first, second = (
            distill_within(self.teacher(), 4000, limits=Limits(4, 15), seed=2).tree for _ in range(2)
        )
        assert first.to_json() == second.to_json()
        assert first.n_nodes <= 15

    def test_one_episode_is_enough(self):
        found = distill_within(self.teacher(), 1, limits=Limits(7, None), seed=0)
        assert found.tree.n_leaves <= 16

    @pytest.mark.parametrize(
        ("limits", "sizes"),
        [
            (Limits(7, None), [4, 8, 16, 32, 64, 128]),
            (Limits(9, None), [4, 8, 16, 32, 64, 128]),
            (Limits(3, None), [4, 8]),
            (Limits(1, None), [2]),
            (Limits(7, 19), [4, 8, 10]),
        ],
    )
    def test_sizes_are_within_the_limits(self, limits, sizes):
        assert _sizes(limits) == sizes

    @pytest.mark.parametrize(
        ("returns", "by_chance", "chosen"),
        [
            ([[1, 1, 1], [5, 5, 5], [6, 6, 6]], 0, 2),
            ([[1, 1, 1], [5, 8.9, 4], [6, 6, 6]], 0, 1),
            ([[1, 1, 1], [5, 7, 4], [6, 6, 6]], 0, 2),
            ([[1, 1, 1], [5, 7, 4], [6, 6, 6]], -100, 1),
            ([[2], [3], [3]], 0, 1),
            ([[2, 2], [1, 1]], 9, 0),
        ],
    )
    def test_the_smallest_that_is_about_as_good_as_the_best(self, returns, by_chance, chosen):
        assert _smallest([np.array(r, float) for r in returns], by_chance) == chosen


def test_the_command_says_what_the_teacher_did(tmp_path, capsys):
    run = tmp_path / "run"
    assert status_of("train", "CartPole-v1", "--eval-episodes", "3", *flags(AUTO), "--run-dir", run) == 0
    said = capsys.readouterr()
    assert "after an MLP that is its teacher" in said.err
    assert "teacher  an MLP earned" in said.out
    guide = json.loads((run / "summary.json").read_text())["guide"]
    assert guide["began_with"] in ("the distilled tree", "a single leaf")
    assert guide["teacher_timesteps"] >= 2048
    assert guide["distill_timesteps"] > 0
    assert status_of("show", run) == 0
    assert "teacher  an MLP earned" in capsys.readouterr().out
