"""Presets: every one can be trained with, and says where it comes from."""

import tomllib
from importlib.resources import files

import pytest

from sympol.algorithms.config import KNOBS, Config, ConfigError
from sympol.algorithms.presets import ANY, preset, presets_of, search_defaults
from sympol.algorithms.recipe import recipe
from sympol.algorithms.registry import ALGORITHMS

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


def sections(env: str) -> dict:
    file = files("sympol") / "presets" / f"{env}.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


PRESETS = [
    pytest.param(env, algorithm, policy, name, values, id=f"{env}-{algorithm}-{policy}-{name}")
    for env in ENVIRONMENTS
    for algorithm, policies in sections(env).items()
    if algorithm != "search"
    for policy, named in policies.items()
    for name, values in named.items()
]
"""Whatever the files hold, also what nobody asks for."""


@pytest.mark.parametrize("env", ENVIRONMENTS)
def test_every_environment_has_defaults_of_the_search(env):
    defaults, general = search_defaults(env), search_defaults(ANY)
    assert defaults.keys() == general.keys() == {"minutes", "teachers", "shares"}
    assert defaults["shares"].keys() == general["shares"].keys()


@pytest.mark.parametrize(("env", "algorithm", "policy", "name", "values"), PRESETS)
def test_every_preset_is_a_valid_config_and_says_where_it_comes_from(env, algorithm, policy, name, values):
    assert algorithm in ALGORITHMS
    assert policy in KNOBS["policy"].choices
    assert len(values["source"]) > 20
    which = {"algorithm": algorithm, "policy": policy}
    config = Config.from_dict({**which, **preset(env, name, **which)})
    for field, value in values.items():
        if field != "source":
            assert getattr(config, field) == (tuple(value) if isinstance(value, list) else value)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("policy", KNOBS["policy"].choices)
def test_an_environment_without_a_file_gets_the_defaults_of_any(algorithm, policy):
    which = {"algorithm": algorithm, "policy": policy}
    assert presets_of("Nowhere-v0", **which) == {}
    assert preset("Nowhere-v0", **which) == preset(ANY, **which)
    Config.from_dict({**which, **preset("Nowhere-v0", **which)})
    assert preset("Nowhere-v0", **which)["dynamic_rollout"] is False
    with pytest.raises(
        ConfigError, match=rf"no preset 'paper' for {algorithm} with {policy}; it has none but"
    ):
        preset("Nowhere-v0", "paper", **which)


@pytest.mark.parametrize("env", ENVIRONMENTS)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("policy", KNOBS["policy"].choices)
def test_a_default_of_its_own_goes_before_that_of_any(env, algorithm, policy):
    which = {"algorithm": algorithm, "policy": policy}
    default = presets_of(env, **which).get("default", presets_of(ANY, **which).get("default"))
    if default is None:  # for which there is a recipe
        default = recipe({}, policy=policy)
    assert preset(env, **which) == {k: v for k, v in default.items() if k != "source"}
    Config.from_dict({**which, **preset(env, **which)})


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
