"""Ids of the form ``module:id``: the module is imported, and what it registers is what is played."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import sympol
from sympol.envs.adapters import ADAPTERS
from sympol.envs.entries import REGISTERED

MODULE = """
import gymnasium
import numpy as np
import sympol
from sympol.envs.adapters import ADAPTERS
from sympol.envs.classic.cartpole import CartPole
from sympol.envs.entries import Adapter, Entry


class Boiler(gymnasium.Env):
    observation_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)
    feature_names = ("outside", "inside")
    action_names = ("off", "on")

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(2, np.float32), {}

    def step(self, action):
        return np.zeros(2, np.float32), float(action), False, False, {}


class Foreign(Adapter):
    def entry(self, env_id):
        return Entry(host=Boiler)


gymnasium.register("Boiler-v0", entry_point=Boiler, max_episode_steps=5)
gymnasium.register("Named-v0", entry_point=Boiler, max_episode_steps=5)
sympol.register("Named-v0", feature_names=("a", "b"))
sympol.register("Pole-v0", CartPole())
ADAPTERS["Foreign/"] = Foreign
"""


@pytest.fixture(autouse=True)
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A module ``plant`` on the path; what it registers is forgotten afterwards."""
    (tmp_path / "plant.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    tables: list[dict] = [REGISTERED, ADAPTERS, gymnasium.registry]
    before = [dict(table) for table in tables]
    yield
    sys.modules.pop("plant", None)
    for table, entries in zip(tables, before, strict=True):
        table.clear()
        table.update(entries)


def test_what_the_module_registers_with_sympol_is_found():
    spec = sympol.resolve("plant:Pole-v0")
    assert spec.env is not None
    assert spec.name == "plant:Pole-v0"


def test_what_an_adapter_of_the_module_has_is_found():
    assert sympol.resolve("plant:Foreign/thing").make_host is not None


def test_names_that_the_module_registers_are_used():
    spec = sympol.resolve("plant:Named-v0")
    assert spec.features.names == ("a", "b")
    assert spec.actions.names == ("off", "on")
    assert spec.host_envs(2).reset(seed=0).shape == (2, 2)


@pytest.mark.parametrize("made", ["id", "object", "function"])
def test_an_environment_keeps_its_names_inside_the_wrappers_of_make(made):
    make = {
        "id": lambda: "plant:Boiler-v0",
        "object": lambda: gymnasium.make("plant:Boiler-v0"),
        "function": lambda: lambda: gymnasium.make("plant:Boiler-v0"),
    }[made]
    assert sympol.resolve(make()).features.names == ("outside", "inside")


def test_another_wrapper_hides_them():
    env = gymnasium.wrappers.RescaleObservation(
        gymnasium.make("plant:Boiler-v0"), np.float32(0), np.float32(1)
    )
    assert sympol.resolve(env).features.names == ("x[0]", "x[1]")


def test_an_unknown_id_of_the_module_is_refused():
    with pytest.raises(
        ValueError, match=r"unknown environment .plant:Boilr-v0.: .* did you mean .*Boiler-v0"
    ):
        sympol.resolve("plant:Boilr-v0")
