"""Every bad value is refused where it enters, by name, with the rule."""

from __future__ import annotations

import dataclasses
import math
import re

import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.config import KNOBS, Config, ConfigError, Hyperparameters

FIELDS = {field.name: field.default for field in dataclasses.fields(Config)}
NUMBERS = {name for name, default in FIELDS.items() if type(default) in (int, float)}
RULES = {name: (rule.low, rule.high) for name, rule in KNOBS.items() if rule.low is not None}
OWNERS = {name: rule.only for name, rule in KNOBS.items() if rule.only}


def refused(name: str, value: object) -> str:
    with pytest.raises(ConfigError) as error:
        Config(**{name: value})
    message = str(error.value)
    assert name in message
    return message


def whose(name: str) -> dict[str, str]:
    """An algorithm and a policy that have the field."""
    owner = OWNERS.get(name, ("tree",))[0]
    return {"algorithm" if owner in ("ppo", "a2c") else "policy": owner}


@pytest.mark.parametrize("name", sorted(OWNERS))
@pytest.mark.parametrize("algorithm", ["ppo", "a2c"])
@pytest.mark.parametrize("policy", ["tree", "mlp", "sdt"])
def test_a_field_of_others_is_refused_and_not_written(name, algorithm, policy):
    new = {"surrogate": "softsign", "dynamic_batch": False, "actor_hidden": (3,), "temperature": 0.5}
    new |= {"threshold_init": "visited", "grow_splits": True, "method": "auto"}
    default = FIELDS[name]
    value = new.get(name, default + 1 if isinstance(default, int) else 0.125)
    config = {"algorithm": algorithm, "policy": policy, name: value}
    if name == "method" and policy == "tree":
        config["grow_splits"] = True
    if {algorithm, policy} & set(OWNERS[name]):
        assert getattr(Config(**config), name) == value
        assert name in Config(**config).to_dict()
        return
    with pytest.raises(ConfigError, match=f"{name} belongs to {' and '.join(OWNERS[name])}; .* has none"):
        Config(**config)
    config.pop(name)
    assert name not in Config(**config).to_dict()
    assert Config.from_dict(Config(**config).to_dict()) == Config(**config)


@pytest.mark.parametrize("growth", [3, 12, 127])
def test_growth_doubles(growth):
    with pytest.raises(ConfigError, match=f"growth must be a power of two, .* got {growth}"):
        Config(growth=growth)


def test_growth_bounds_the_stages():
    stages = [Config(num_envs=1, num_steps=16, growth=2**k).max_stage for k in range(8)]
    assert stages == list(range(8))


def test_every_number_has_a_rule():
    assert set(RULES) == NUMBERS
    assert set(Hyperparameters._fields) <= NUMBERS


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_numbers_out_of_range_are_refused(name):
    low, high = RULES[name]
    whole = isinstance(FIELDS[name], int)
    bad = [low - 1, *([high + 1] if high < math.inf else [])]
    bad += [10**400] if high < math.inf else []
    bad += [] if whole else [-math.inf, *([math.inf] if high < math.inf else [])]
    for value in bad:
        message = refused(name, value)
        assert str(low) in message
        assert str(high) in message
        assert str(value) in message


@pytest.mark.parametrize("name", sorted(FIELDS))
def test_nan_and_wrong_types_are_refused(name):
    wrong: list[object] = [None, math.nan, [1], "three", b"3", {}, np.float32(np.nan), np.arange(2), 1j]
    if not isinstance(FIELDS[name], bool):
        wrong += [True, np.True_, np.array(True)]
    if not isinstance(FIELDS[name], float):
        wrong += [0.5, np.float32(0.5)]
    if isinstance(FIELDS[name], bool):
        wrong += [1, np.int64(1)]
    for value in wrong:
        message = refused(name, value)
        assert repr(value) in message
        assert "must be" in message


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_the_ends_of_every_range_are_allowed(name):
    for value in RULES[name]:
        others = {"total_timesteps": 2**29} if name in ("num_envs", "num_steps") else {}
        if name == "total_timesteps" and value == 1:
            continue  # shorter than one rollout
        others |= whose(name)
        kind = type(FIELDS[name])
        if name == "num_devices" and value > 1:
            others |= {"num_envs": value, "total_timesteps": 2**29}
        if name in ("num_envs", "num_steps") and value > 1:
            others |= {"num_envs" if name == "num_steps" else "num_steps": 16}
        assert getattr(Config(**{name: kind(value), **others}), name) == value


def test_words_and_shapes():
    assert "softsign" in refused("surrogate", "tanh")
    assert "power of two, got 0.3" in refused("temperature", 0.3)
    assert "mlp, tree" in refused("critic", "forest")
    assert "(64, 0)" in refused("critic_hidden", (64, 0))
    assert "(64, 8.5)" in refused("critic_hidden", (64, 8.5))
    assert "(True,)" in refused("critic_hidden", (True,))
    assert Config(critic_hidden=()).critic_hidden == ()


def test_a_tree_too_deep_says_how_large_it_would_be():
    message = refused("depth", 40)
    assert "between 1 and 14, got 40" in message
    assert "2^40 leaves" in message


def test_fewer_steps_than_a_rollout():
    config = Config(total_timesteps=16 * 32, num_envs=32, num_steps=128)
    assert config.chunk_size == 512
    message = refused("total_timesteps", 511)
    assert "511" in message
    assert "512" in message
    assert "num_envs" in message
    with pytest.raises(ConfigError, match="4096"):
        Config(total_timesteps=4095, dynamic_rollout=False)


def test_unknown_fields_name_their_neighbours():
    with pytest.raises(ConfigError, match=r"'learning_rate_leafs'.*did you mean.*learning_rate_leaf_values"):
        Config.from_dict({"learning_rate_leafs": 0.1})
    with pytest.raises(ConfigError, match=re.escape("unknown config field 'zzzz'") + "$"):
        Config.from_dict({"zzzz": 1})


def test_dictionaries_round_trip():
    config = Config(depth=3, critic_hidden=(8, 4), gamma=0.5, surrogate="softsign", reduce_lr=True)
    assert Config.from_dict(config.to_dict()) == config
    assert config.to_dict()["critic_hidden"] == [8, 4]
    assert Config.from_dict({}) == Config()
    with pytest.raises(ConfigError, match="gamma"):
        Config.from_dict({"gamma": "high"})


def test_a_whole_number_will_do_for_a_float():
    assert Config(gamma=1).hyperparameters().gamma == np.float32(1)


class Seven:
    def __index__(self) -> int:
        return 7


@pytest.mark.parametrize(
    ("name", "value", "plain"),
    [
        ("depth", np.int64(7), 7),
        ("depth", np.uint8(7), 7),
        ("depth", np.array(7), 7),
        ("depth", jnp.int32(7), 7),
        ("depth", Seven(), 7),
        ("depth", np.float32(7), 7),
        ("total_timesteps", 1e6, 1_000_000),
        ("gamma", np.float32(0.5), 0.5),
        ("gamma", np.float16(0.5), 0.5),
        ("gamma", np.int64(1), 1),
        ("normalize_obs", np.bool_(False), False),
        ("surrogate", np.str_("softsign"), "softsign"),
        ("critic_hidden", (np.int64(8), 4.0), (8, 4)),
    ],
)
def test_numpys_scalars_and_whole_floats_are_numbers(name, value, plain):
    config = Config(**{name: value})
    kept = getattr(config, name)
    assert kept == plain
    assert type(kept) is type(plain)
    assert config == Config(**{name: plain})
    assert config.to_dict() == Config(**{name: plain}).to_dict()
    assert Config.from_dict({name: value}) == config


def test_hyperparameters_are_float32_and_static_forgets_them():
    config = Config(gamma=0.5, weight_decay=0.25, depth=3)
    hyper = config.hyperparameters()
    assert all(isinstance(value, np.float32) for value in hyper)
    assert (hyper.gamma, hyper.weight_decay) == (0.5, 0.25)
    assert config.static() == Config(depth=3)
    assert hash(config.static()) == hash(Config(depth=3))


@pytest.mark.parametrize(
    ("num_steps", "first"), [(16, 16), (128, 16), (129, 16), (256, 32), (1, 16), (1000, 125)]
)
def test_the_first_rollout(num_steps, first):
    config = Config(num_steps=num_steps, num_envs=2)
    assert config.chunk_steps == first
    assert config.chunk_size == 2 * first


def test_growth_stops_where_a_rollout_would_outgrow_its_stage():
    def most(total: int) -> int:
        return Config(total_timesteps=total, num_envs=2, num_steps=16).max_stage

    chunk = 32
    assert most(chunk) == 0
    assert most(8 * chunk * 2 - 1) == 0
    assert most(8 * chunk * 2) == 1
    assert most(8 * chunk * 127) == 6
    assert most(8 * chunk * 128) == 7
    assert most(8 * chunk * 10_000) == 7


def test_dynamic_rollout_off_keeps_one_size():
    config = Config(dynamic_rollout=False, num_steps=128, num_envs=4)
    assert (config.max_stage, config.chunk_steps, config.chunk_size) == (0, 128, 512)
