"""The complete examples in the guides for newcomers run."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import numpy as np
import pytest

import sympol
from sympol.algorithms.registry import ALGORITHMS
from sympol.envs.adapters import ADAPTERS
from sympol.envs.errors import UnknownEnvironment
from sympol.trees import DecisionTree

from .tiny import quick_compiles

__all__ = ["quick_compiles"]

GUIDES = Path(__file__).resolve().parents[1] / "docs" / "guides"


@pytest.fixture(autouse=True)
def promotion():
    """Mix dtypes as users may; our own code must not."""
    with jax.numpy_dtype_promotion("standard"):
        yield


def run_page(name: str) -> dict[str, Any]:
    """Execute the Python of a page as a module, one block after another, and return its names."""
    text = (GUIDES / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    module = sys.modules[name] = ModuleType(name)  # where dataclasses look for the names of their fields
    try:
        exec(compile("\n".join(blocks), f"{name}.md", "exec"), vars(module))
    finally:
        del sys.modules[name]
    return vars(module)


def test_a_simulator_is_trained_as_the_guide_says():
    names = run_page("your-simulator")
    assert names["agent"].spec.features.names == ("level", "pump is off", "pump is on")
    for simulator in (names["tank"], names["boiler"]):
        env = simulator()
        env.reset(seed=0)
        for _ in range(100):
            observation, _, terminated, truncated, _ = env.step(env.action_space.sample())
            assert env.observation_space.contains(observation)
            assert not terminated
        assert truncated == (simulator is names["boiler"])


@pytest.mark.slow
def test_an_environment_is_added_as_the_guide_says():
    try:
        names = run_page("add-an-environment")
        with pytest.raises(UnknownEnvironment, match="did you mean 'walks/long'"):
            sympol.resolve("walks/lnog")
    finally:
        ADAPTERS.pop("walks/", None)
    assert names["mean"] > 0
    assert names["long_walk"].backend == "jax"
    assert len(names["long_walk"].features.names) == 9
    assert isinstance(names["agent"].tree(), DecisionTree)
    graph = names["spec"].state_graph()
    env, cells = names["KnownWalk"](), names["CELLS"]
    for cell in range(cells - 1):
        for action in (0, 1):
            _, step = env.step(None, (np.int32(cell), np.int32(0)), np.int32(action))
            after = graph.successor[cell, action]
            assert bool(step.terminated) == bool(graph.reaches_goal[cell, action]) == (after < 0)
            assert after < 0 or (graph.observations[graph.observation_of[after]] == step.observation).all()
            if after < 0:
                assert float(step.reward) == pytest.approx(float(graph.reward_at[1]))
    assert (names["spec"].all_observations() == np.eye(cells)).all()
    assert sympol.resolve("Walk-v0").env is not None


@pytest.mark.slow
def test_an_algorithm_is_added_as_the_guide_says():
    try:
        names = run_page("add-an-algorithm")
    finally:
        ALGORITHMS.pop("reinforce", None)
    agent = names["agent"]
    assert isinstance(agent.tree(), DecisionTree)
    assert agent.num_timesteps >= 8_192
