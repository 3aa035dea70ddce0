"""Presets: every one can be trained with, and says where it comes from."""

from importlib.resources import files

import pytest

from sympol.algos.config import Config
from sympol.algos.presets import preset, presets_of

ENVIRONMENTS = sorted(
    file.name.removesuffix(".toml")
    for file in (files("sympol") / "presets").iterdir()
    if file.name.endswith(".toml")
)
OF_THE_PAPER = [
    "Acrobot-v1",
    "CartPole-v1",
    "LunarLander-v3",
    "MiniGrid-DistShift1-v0",
    "MiniGrid-DoorKey-5x5-v0",
    "MiniGrid-Empty-Random-6x6-v0",
    "MiniGrid-LavaGapS5-v0",
    "MiniGrid-LavaGapS7-v0",
    "MountainCar-v0",
    "MountainCarContinuous-v0",
    "Pendulum-v1",
]


@pytest.mark.parametrize("env", ENVIRONMENTS)
def test_every_preset_of_the_tree_is_a_valid_config(env):
    for name in presets_of(env):
        Config.from_dict(preset(env, name))


@pytest.mark.parametrize("env", ENVIRONMENTS)
@pytest.mark.parametrize("policy", ["tree", "mlp", "sdt"])
def test_every_preset_says_where_it_comes_from(env, policy):
    for values in presets_of(env, policy).values():
        assert len(values["source"]) > 20


@pytest.mark.parametrize("env", OF_THE_PAPER)
@pytest.mark.parametrize("policy", ["tree", "mlp", "sdt"])
def test_the_paper_s_are_there_for_every_environment_and_method(env, policy):
    paper = presets_of(env, policy)["paper"]
    assert paper["clip_eps"] == 0.1
    assert paper["num_envs"] <= 16


def test_numbers_are_the_paper_s():
    tree, mlp, sdt = (
        presets_of("MiniGrid-DoorKey-5x5-v0", policy)["paper"] for policy in ("tree", "mlp", "sdt")
    )
    assert tree["learning_rate_feature_logits"] == 0.0005029536099891734
    assert tree["learning_rate_leaf_values"] == 0.0035778989299146166
    assert (mlp["actor_hidden"], mlp["learning_rate_actor"]) == ([169], 0.0004126)
    assert (sdt["depth"], sdt["critic"], sdt["vf_coef"]) == (6, "mlp", 0.75)
