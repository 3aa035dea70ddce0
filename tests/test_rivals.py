"""The tree's rivals and the other algorithm, as their users meet them: agents, runs, commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete

import sympol
from sympol.agents import Agent
from sympol.algorithms.state import TrainState

from .tiny import Chain, csv_without_time, flags, quick_compiles, read_summary, refused, status_of

__all__ = ["quick_compiles"]

SHARED: dict[str, Any] = {
    "total_timesteps": 2048,
    "num_envs": 4,
    "num_steps": 16,
    "critic_hidden": (8,),
    "num_evals": 8,
    "num_eval_episodes": 4,
}
OF_POLICY: dict[str, dict[str, Any]] = {
    "tree": {"depth": 3},
    "sdt": {"depth": 3, "temperature": 0.5},
    "mlp": {"actor_hidden": (8,)},
}
OF_ALGORITHM: dict[str, dict[str, Any]] = {"ppo": {"minibatch_size": 64, "num_epochs": 1}, "a2c": {}}
AGENTS = {"ppo": sympol.PPO, "a2c": sympol.A2C}
ALL = [("ppo", "mlp"), ("ppo", "sdt"), ("a2c", "tree"), ("a2c", "mlp")]
EVERYONE = pytest.mark.parametrize(("algorithm", "policy"), ALL)
NO_TREE = pytest.mark.parametrize(("algorithm", "policy"), [who for who in ALL if who[1] != "tree"])

X = np.random.default_rng(0).normal(size=(1000, 4)).astype(np.float32)
"""Observations of CartPole."""


def tiny(algorithm: str, policy: str) -> dict[str, Any]:
    return {**SHARED, **OF_POLICY[policy], **OF_ALGORITHM[algorithm]}


def agent(algorithm: str, policy: str, env: Any = "CartPole-v1", **options: Any) -> Agent:
    return AGENTS[algorithm](policy, env, **{**tiny(algorithm, policy), **options})


def trained(*who: Any, **options: Any) -> Agent:
    return agent(*who, **options).learn(progress_bar=False)


_TRAINED: dict[tuple[str, str], Agent] = {}


@pytest.fixture
def on_cartpole(algorithm, policy) -> Agent:
    """Trained once for all tests of this file."""
    if (algorithm, policy) not in _TRAINED:
        _TRAINED[algorithm, policy] = trained(algorithm, policy)
    return _TRAINED[algorithm, policy]


def assert_same_to_the_bit(one: TrainState | None, other: TrainState | None) -> None:
    """All but the metrics of the last update: a checkpoint holds none."""
    assert one is not None
    assert other is not None
    jax.tree.map(np.testing.assert_array_equal, one._replace(metrics={}), other._replace(metrics={}))


@EVERYONE
def test_it_trains_for_all_its_steps(on_cartpole, algorithm, policy):
    assert on_cartpole.num_timesteps == 2048
    assert (on_cartpole.config.algorithm, on_cartpole.config.policy) == (algorithm, policy)
    begun = agent(algorithm, policy)
    begun.learn(callback=lambda report: False, progress_bar=False)
    for before, after in zip(*(jax.tree.leaves(a.state.networks) for a in (begun, on_cartpole)), strict=True):
        assert not before.size or np.any(np.asarray(before) != np.asarray(after))


@EVERYONE
def test_predict_one_and_many(on_cartpole):
    one, state = on_cartpole.predict(X[0])
    many, _ = on_cartpole.predict(X[:50])
    assert state is None
    assert np.ndim(one) == 0
    assert one in {0, 1}
    assert one == many[0]
    assert many.shape == (50,)
    assert many.dtype == np.int64
    assert all(Discrete(2).contains(action) for action in many)
    assert np.array_equal(many, on_cartpole.outputs(X[:50]).argmax(1))
    with pytest.raises(ValueError, match=r"observation must be an array of real numbers of shape \(4,\)"):
        on_cartpole.predict(np.zeros(3))


@EVERYONE
def test_predict_can_sample(on_cartpole):
    many, _ = on_cartpole.predict(X, deterministic=False)
    assert many.shape == (1000,)
    assert many.dtype == np.int64
    assert np.ndim(on_cartpole.predict(X[0], deterministic=False)[0]) == 0
    logits = on_cartpole.outputs(X).astype(np.float64)
    chance = 1 / (1 + np.exp(logits[:, 0] - logits[:, 1]))  # of action 1
    error = np.sqrt(np.sum(chance * (1 - chance)))
    assert abs(many.sum() - chance.sum()) < 4 * error


@EVERYONE
def test_outputs_do_not_depend_on_the_batch(on_cartpole):
    """Rows beyond the batch fill it up to a power of two; none of them may leak into the others."""
    whole = on_cartpole.outputs(X[:64])
    assert whole.shape == (64, 2)
    for size in (1, 3):
        parts = [on_cartpole.outputs(X[i : i + size]) for i in range(0, 64 - size, size)]
        assert all(part.shape == (size, 2) for part in parts)
        found = np.concatenate(parts)
        np.testing.assert_allclose(found, whole[: len(found)], rtol=1e-5, atol=1e-6)


@EVERYONE
def test_outputs_are_the_actor_s_on_scaled_observations(on_cartpole):
    state = on_cartpole.state
    assert state is not None
    x = (X[:64] - np.asarray(state.normalizer.shift)) * np.asarray(state.normalizer.scale)
    expected = jax.jit(lambda actor, x: actor(x))(on_cartpole.actor, x)
    np.testing.assert_allclose(on_cartpole.outputs(X[:64]), expected, rtol=1e-5, atol=1e-6)


@NO_TREE
def test_there_is_no_tree_in_it(on_cartpole, policy):
    assert not on_cartpole.has_tree
    with pytest.raises(RuntimeError, match=f"{policy} is no tree; make one of it with `sympol distill`"):
        on_cartpole.tree()


@EVERYONE
def test_nothing_acts_before_learning(algorithm, policy):
    new = agent(algorithm, policy)
    for verb in (new.tree, lambda: new.predict(X[0]), lambda: new.outputs(X)):
        with pytest.raises(RuntimeError, match=r"call learn\(\) first"):
            verb()


@EVERYONE
def test_save_and_load(on_cartpole, tmp_path, algorithm, policy):
    on_cartpole.save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert type(again) is AGENTS[algorithm]
    assert (again.config, again.seed, again.has_tree) == (on_cartpole.config, 0, policy == "tree")
    assert_same_to_the_bit(again.state, on_cartpole.state)
    assert np.array_equal(again.predict(X)[0], on_cartpole.predict(X)[0])
    assert np.array_equal(again.outputs(X), on_cartpole.outputs(X))
    assert (tmp_path / "run" / "policy.json").exists() == (policy == "tree")


@pytest.mark.parametrize(("algorithm", "policy"), [("ppo", "mlp"), ("a2c", "tree")])
def test_a_stopped_training_goes_on_to_the_same_end(on_cartpole, tmp_path, algorithm, policy):
    stopped = agent(algorithm, policy)
    stopped.learn(callback=lambda report: report.timestep < 1000, progress_bar=False)
    assert 1000 <= stopped.num_timesteps < 2048
    stopped.save(tmp_path / "run")
    again = sympol.load(tmp_path / "run")
    assert_same_to_the_bit(again.state, stopped.state)
    for one in (again, stopped):
        assert_same_to_the_bit(one.learn(progress_bar=False).state, on_cartpole.state)


@EVERYONE
def test_it_can_be_evaluated(on_cartpole):
    returns, lengths = sympol.evaluate_policy(on_cartpole, "CartPole-v1", 3, return_episode_rewards=True)
    assert returns == [float(n) for n in lengths]
    assert sympol.evaluate_policy(on_cartpole, "CartPole-v1", 3)[0] == np.mean(returns)


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "policy"), [("ppo", "sdt"), ("a2c", "mlp")])
def test_continuous_actions_stay_within_bounds(algorithm, policy, tmp_path):
    one = trained(algorithm, policy, "Pendulum-v1", log_std_init=1.0)
    space, x = one.spec.action_space, X[:, :3]
    for deterministic in (True, False):
        action, _ = one.predict(x[0], deterministic=deterministic)
        assert space.contains(action)
        many, _ = one.predict(x, deterministic=deterministic)
        assert (many.shape, many.dtype) == ((1000, 1), np.float32)
        assert all(space.contains(action) for action in many)
    assert {-2, 2} <= {*np.unique(many).tolist()}  # noise of size e, clipped at both bounds
    mean, std = one.outputs(x), float(np.exp(one.actor.log_std[0]))
    assert one.actions.std == pytest.approx((std,))
    np.testing.assert_array_equal(one.predict(x)[0], np.clip(mean, -2, 2))
    one.save(tmp_path)
    assert np.array_equal(sympol.load(tmp_path).predict(x)[0], one.predict(x)[0])


class Odd(Chain):
    """On the host: features in a box without bounds, two choices at once that do not start at 0."""

    def __init__(self) -> None:
        super().__init__(Box(-np.inf, np.inf, (2,)), MultiDiscrete([2, 3], start=[1, -4]))


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "policy"), [("ppo", "mlp"), ("a2c", "sdt")])
def test_it_trains_on_environments_of_the_host(algorithm, policy, tmp_path):
    one = trained(algorithm, policy, Odd, total_timesteps=256, num_evals=2)
    assert one.spec.backend == "host"
    assert one.num_timesteps == 256
    for deterministic in (True, False):
        many, _ = one.predict(X[:50, :2], deterministic=deterministic)
        assert many.shape == (50, 2)
        assert all(one.spec.action_space.contains(action) for action in many)
    one.save(tmp_path)
    again = sympol.load(tmp_path, env=Odd)
    assert_same_to_the_bit(again.state, one.state)
    stopped = agent(algorithm, policy, Odd, total_timesteps=256, num_evals=2)
    stopped.learn(callback=lambda report: False, progress_bar=False)
    assert stopped.num_timesteps < 256
    assert_same_to_the_bit(stopped.learn(progress_bar=False).state, one.state)


def test_each_policy_and_algorithm_has_its_own_fields():
    with pytest.raises(ValueError, match="actor_hidden belongs to mlp; sdt has none"):
        agent("ppo", "sdt", actor_hidden=(8,))
    with pytest.raises(ValueError, match="num_epochs belongs to ppo; a2c has none"):
        agent("a2c", "mlp", num_epochs=2)
    with pytest.raises(ValueError, match="critic must be mlp or"):
        agent("ppo", "mlp", critic="sdt")


# --- the commands ---

A2C_MLP = ["--algorithm", "a2c", "--policy", "mlp", *flags(tiny("a2c", "mlp"))]


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A finished run of an MLP."""
    path = tmp_path_factory.mktemp("rivals") / "run"
    assert status_of("train", "CartPole-v1", *A2C_MLP, "--eval-episodes", "3", "--run-dir", path) == 0
    return path


def test_the_command_and_the_verbs_train_the_same(run):
    by_verbs = trained("a2c", "mlp")
    again = sympol.load(run)
    assert again.config == by_verbs.config
    assert_same_to_the_bit(again.state, by_verbs.state)


def test_a_run_without_a_tree(run):
    files = {file.name for file in run.iterdir()}
    assert files == {"config.toml", "metrics.csv", "checkpoints", "summary.json"}
    summary = read_summary(run)
    assert summary["episodes"] == 3
    assert summary["timesteps"] == 2048
    assert not {"nodes", "leaves", "depth"} & summary.keys()
    written = (run / "config.toml").read_text()
    assert 'policy = "mlp"' in written
    assert "actor_hidden" in written
    assert "surrogate" not in written  # a tree's


def test_train_says_what_and_what_next(tmp_path, capsys):
    path = tmp_path / "run"
    assert status_of("train", "CartPole-v1", *A2C_MLP, "--eval-episodes", "3", "--run-dir", path) == 0
    said = capsys.readouterr()
    assert "training an MLP (8) on CartPole-v1, seed 0" in said.err
    assert f"sympol eval {path}" in said.out
    assert f"sympol distill {path}" in said.out
    assert "sympol show" not in said.out
    assert "nodes" not in said.out


def test_eval_plays_what_evaluate_policy_plays(run, capsys):
    assert status_of("eval", run, "--episodes", "5", "--seed", "7", "--json") == 0
    result = json.loads(capsys.readouterr().out)
    expected = sympol.evaluate_policy(sympol.load(run), "CartPole-v1", 5, seed=7)
    assert (result["return_mean"], result["return_std"]) == expected


@pytest.mark.parametrize("command", ["show", "export"])
def test_what_needs_a_tree_says_that_there_is_none(run, capsys, command):
    said = refused(capsys, command, run)
    assert said == f"error: {run} holds 'mlp', which is no tree; make one of it: sympol distill {run}\n"


def test_resume_ends_where_the_whole_training_does(run, tmp_path, capsys):
    path = tmp_path / "run"
    one = agent("a2c", "mlp")
    one.learn(callback=lambda report: report.timestep < 1000, progress_bar=False)
    one.save(path)
    assert status_of("resume", path, "--eval-episodes", "3", "--json") == 0
    said = capsys.readouterr()
    assert f"resuming at step {one.num_timesteps:,} of 2,048" in said.err
    assert_same_to_the_bit(sympol.load(path).state, sympol.load(run).state)
    summary, whole = json.loads(said.out), read_summary(run)
    for name in ("return_mean", "sampled_return_mean", "validation_return", "best_timestep", "timesteps"):
        assert summary[name] == whole[name]
    rows = csv_without_time(run)
    assert csv_without_time(path)[1:] == [row for row in rows[1:] if int(row[0]) > one.num_timesteps]


def test_a_flag_of_another_policy_is_refused_before_any_work(tmp_path, capsys):
    said = refused(
        capsys, "train", "CartPole-v1", "--policy", "mlp", "--depth", "3", "--run-dir", tmp_path / "run"
    )
    assert "depth belongs to tree and sdt; mlp has none" in said
    said = refused(capsys, "train", "CartPole-v1", "--algorithm", "a2c", "--num-epochs", "3")
    assert "num_epochs belongs to ppo; a2c has none" in said
    assert not (tmp_path / "run").exists()
