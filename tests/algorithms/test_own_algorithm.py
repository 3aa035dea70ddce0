"""A new algorithm is one file and one line: the one in `toy.py` is off-policy, and everything around it just works."""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sympol
from sympol.agents import Agent, agent_class
from sympol.algorithms.config import ConfigError
from sympol.algorithms.ppo import PPO
from sympol.algorithms.registry import ALGORITHMS
from sympol.runs.run import Run
from sympol.training import resume_agent, save_into
from tests.envs.probes import Discount, MatchObservation

from .toy import QLearning

CONFIG: dict[str, Any] = {
    "num_envs": 8,
    "num_steps": 16,
    "dynamic_rollout": False,
    "total_timesteps": 8_192,
    "learning_rate_actor": 0.01,
    "actor_hidden": (16,),
    "num_evals": 4,
    "num_eval_episodes": 8,
    "normalize_obs": False,
    "reduce_lr": False,
}


@pytest.fixture(autouse=True)
def one_line(monkeypatch) -> None:
    monkeypatch.setitem(ALGORITHMS, "toy", QLearning)


def toy(policy: str, env: Any, **changes: Any) -> Agent:
    config = {
        name: value for name, value in {**CONFIG, **changes}.items() if policy == "mlp" or "actor" not in name
    }
    return agent_class("toy")(policy, env, **config)


class Match(gymnasium.Env):
    """`MatchObservation` for the host: the action must be the sign of the observation."""

    observation_space = gymnasium.spaces.Box(-1, 1, (1,))
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.sign = self.np_random.choice([-1.0, 1.0])
        return np.array([self.sign], np.float32), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict]:
        right = (action == 1) == (self.sign > 0)
        return np.array([self.sign], np.float32), 1.0 if right else -1.0, True, False, {}


@pytest.mark.parametrize("env", [MatchObservation(), Match], ids=["jax", "host"])
def test_it_learns_on_both_sources_of_experience(env):
    agent = toy("mlp", env).learn(progress_bar=False)
    values = agent.outputs(np.array([[-1.0], [1.0]], np.float32))
    np.testing.assert_allclose(values, [[1, -1], [-1, 1]], atol=0.1)


def test_the_values_of_a_longer_episode_are_discounted():
    agent = toy("mlp", Discount(), gamma=0.5).learn(progress_bar=False)
    values = agent.outputs(np.array([[0.0], [1.0]], np.float32)).max(axis=1)
    np.testing.assert_allclose(values, [0.5, 1], atol=0.1)


def test_a_tree_of_values_is_a_tree_like_any_other():
    agent = toy("tree", MatchObservation(), depth=2).learn(progress_bar=False)
    assert [agent.tree().predict([x]) for x in (-1.0, 1.0)] == [0, 1]


def test_its_metric_is_in_the_file_and_its_memory_in_the_checkpoint(tmp_path):
    def stopped_half_way(report: sympol.agents.Report) -> bool:
        return report.timestep < 4_000

    whole = toy("mlp", MatchObservation()).learn(progress_bar=False)
    half = toy("mlp", MatchObservation())
    with Run.create(tmp_path / "run", half.spec, half.config, half.seed, preset="default") as run:
        half.learn(callback=[save_into(run), stopped_half_way], progress_bar=False)
    run = Run.open(tmp_path / "run", MatchObservation())
    resumed = resume_agent(run)
    assert int(resumed.state.memory.written) == resumed.num_timesteps == 4_096
    resumed.learn(callback=save_into(run), progress_bar=False)
    for a, b in zip(jax.tree.leaves(whole.state), jax.tree.leaves(resumed.state), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
    rows = run.metrics.read()
    assert len(rows) == 4
    assert all(0 <= row["train/td_loss"] < 1 for row in rows)
    assert math.isnan(rows[0]["train/value_loss"])


def test_what_it_does_not_have_is_refused():
    with pytest.raises(ConfigError, match="clip_eps belongs to ppo; toy has none"):
        toy("mlp", MatchObservation(), clip_eps=0.1)
    with pytest.raises(ConfigError, match="algorithm must be one of ppo, a2c, toy, got 'dqn'"):
        sympol.algorithms.config.Config(algorithm="dqn")  # pyright: ignore[reportAttributeAccessIssue]


def returns(result):
    class Wrong(PPO):
        def update(self, hyper, state, experience, key):
            updated, metrics = super().update(hyper, state, experience, key)
            return result(updated, metrics)

    return Wrong


@pytest.mark.parametrize(
    ("result", "message"),
    [
        (
            lambda state, metrics: None,
            r"Wrong.update must return the new state and a dictionary of metrics, got None",
        ),
        (
            lambda state, metrics: (state, {**metrics, "train/odd": jnp.zeros(3)}),
            r"scalar metrics, got 'train/odd' of shape \(3,\)",
        ),
        (
            lambda state, metrics: (state._replace(memory=jnp.zeros(2)), metrics),
            r"same form: memory was absent and is float32\[2\]",
        ),
        (
            lambda state, metrics: (state._replace(timestep=jnp.float32(0)), metrics),
            r"same form: timestep was int32\[\] and is float32\[\]",
        ),
    ],
)
def test_what_an_update_must_return(monkeypatch, result, message):
    monkeypatch.setitem(ALGORITHMS, "wrong", returns(result))
    agent = agent_class("wrong")("tree", "CartPole-v1", depth=2, num_envs=4, num_steps=16)
    with pytest.raises(TypeError, match=message):
        agent.learn(512, progress_bar=False)


@pytest.mark.parametrize(
    ("answer", "stops"), [(False, True), (np.bool_(False), True), (None, False), (0, False)]
)
def test_a_callback_ends_a_training_with_false(answer, stops):
    agent = sympol.PPO(
        "tree", "CartPole-v1", depth=2, num_envs=4, num_steps=16, num_evals=2, num_eval_episodes=2
    )
    agent.learn(512, callback=lambda report: answer, progress_bar=False)
    assert (agent.num_timesteps < 512) == stops


def test_a_start_must_be_a_tree():
    with pytest.raises(TypeError, match=r"start must be a DecisionTree or a sympol.Start, got 'tree.json'"):
        sympol.PPO("tree", "CartPole-v1", start="tree.json")
