"""What is searched: the paper's grids, every point of which is a config that can be trained."""

from __future__ import annotations

import json
import math
from typing import Any

import optuna
import pytest

from sympol.algorithms.config import KNOBS, Config
from sympol.algorithms.registry import ALGORITHMS
from sympol.tune.search_spaces import (
    Range,
    corner,
    fields_of,
    fixed,
    from_json,
    space_of,
    suggest,
    to_json,
)
from sympol.tune.study import Search

WHICH = [(algorithm, policy) for algorithm in ALGORITHMS for policy in KNOBS["policy"].choices]


@pytest.mark.parametrize("env", ["CartPole-v1", "Pendulum-v1"])
@pytest.mark.parametrize("name", ["default", "paper"])
@pytest.mark.parametrize(("algorithm", "policy"), WHICH)
def test_every_point_is_a_config(env, name, algorithm, policy):
    if algorithm == "a2c" and name == "paper":
        pytest.skip("the paper has no tuned A2C")
    search = Search.of(env, policy, algorithm, preset_name=name)
    points: list[dict[str, Any]] = [corner(search.space, 0), corner(search.space, -1)]
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    points += [suggest(study.ask(), search.space) for _ in range(50)]
    for point in points:
        config = search.config_of(point)
        assert (config.algorithm, config.policy, config.total_timesteps) == (algorithm, policy, 1_000_000)
        for field, value in fields_of(point).items():
            assert getattr(config, field) == value


def test_the_grids_are_the_papers():
    tree = space_of("ppo", "tree", continuous=True)
    assert tree["learning_rate_feature_logits"] == Range(1e-4, 0.1, log=True)
    assert tree["learning_rate_thresholds"] == Range(1e-4, 0.05, log=True)
    assert tree["learning_rate_leaf_values"] == Range(1e-4, 0.05, log=True)
    assert tree["num_epochs"] == Range(1, 10)
    assert tree["reduce_lr"] == (False, True)
    assert fixed("ppo", "tree") == {"depth": 7, "minibatch_size": 64, "max_grad_norm": math.inf}
    mlp = space_of("ppo", "mlp", continuous=True)
    assert (mlp["hidden_width"], mlp["hidden_layers"]) == (Range(16, 256), Range(1, 3))
    sdt = space_of("ppo", "sdt", continuous=True)
    assert sdt["temperature"] == (0.01, 0.05, 0.1, 0.5, 1.0)
    assert (sdt["depth"], sdt["critic"]) == (Range(4, 8), ("mlp", "sdt"))
    for rival in (mlp, sdt):
        assert rival["learning_rate_actor"] == Range(1e-4, 0.01, log=True)
        assert rival["minibatch_size"] == (64, 128, 256, 512)
        assert rival["max_grad_norm"] == (0.1, 0.5, 1.0, math.inf)
        assert "reduce_lr" not in rival
    for space in (tree, mlp, sdt):
        assert (space["num_steps"], space["num_envs"]) == ((128, 512), Range(4, 16))
        assert space["gae_lambda"] == (0.8, 0.9, 0.95, 0.99)
        assert space["gamma"] == (0.9, 0.95, 0.99, 0.999)


def test_discrete_actions_have_no_deviation_to_learn():
    assert "learning_rate_log_std" in space_of("ppo", "tree", continuous=True)
    assert "learning_rate_log_std" not in space_of("ppo", "tree", continuous=False)


def test_a2c_searches_what_it_has_and_shorter_rollouts():
    space = space_of("a2c", "mlp", continuous=False)
    assert not {"num_epochs", "minibatch_size"} & {*space}
    assert space["num_steps"] == (16, 128, 512)


def test_layers_of_an_mlp_are_of_one_width_and_so_is_its_critic():
    fields = fields_of({"hidden_width": 20, "hidden_layers": 3, "gamma": 0.9})
    assert fields == {"actor_hidden": (20, 20, 20), "critic_hidden": (20, 20, 20), "gamma": 0.9}


@pytest.mark.parametrize(("algorithm", "policy"), WHICH)
def test_a_search_survives_json(algorithm, policy):
    space = space_of(algorithm, policy, continuous=True)
    assert from_json(json.loads(json.dumps(to_json(space)))) == space
    search = Search.of("CartPole-v1", policy, algorithm)
    back = Search.from_json(json.loads(json.dumps(search.to_json())))
    assert back.differences(search) == []
    assert back.config_of(corner(space, 0)) == search.config_of(corner(space, 0))
    assert isinstance(back.config_of(corner(back.space, -1)), Config)
