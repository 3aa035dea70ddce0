"""No observations, no actions: an empty batch is answered with an empty one, whoever is asked."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete

import sympol
from sympol.serving import SymbolicPolicy

CARTPOLE = {"env": "CartPole-v1", "num_envs": 2, "num_steps": 16, "total_timesteps": 64, "num_evals": 1}


class Mixed(gymnasium.Env):
    observation_space = Dict({"level": Box(-1, 1, (2,)), "mode": Discrete(2)})
    action_space = MultiDiscrete([2, 3])

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return {"level": [0.5, 0], "mode": True}, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return {"level": [0, 0.5], "mode": False}, 1.0, True, False, {}


@pytest.mark.parametrize("policy", ["tree", "mlp", "sdt"])
@pytest.mark.parametrize("deterministic", [True, False])
def test_an_agent(policy: str, deterministic: bool) -> None:
    agent = sympol.PPO(policy, **CARTPOLE).learn(progress_bar=False)
    for batch in (np.zeros((0, 4), np.float32), np.zeros((0, 4), int), []):
        actions, _ = agent.predict(batch, deterministic=deterministic)
        assert actions.shape == (0,)
        assert actions.dtype == np.int64
    assert agent.outputs(np.zeros((0, 4), np.float32)).shape == (0, 2)


def test_an_agent_of_parts() -> None:
    agent = sympol.PPO("tree", Mixed, num_envs=2, num_steps=16, total_timesteps=64, num_evals=1).learn(
        progress_bar=False
    )
    actions, _ = agent.predict({"level": np.zeros((0, 2)), "mode": []})
    assert actions.shape == (0, 2)
    assert agent.predict({"level": [0, 0], "mode": True})[0].shape == (2,)


def test_a_tree_with_and_without_an_environment() -> None:
    agent = sympol.PPO("tree", **CARTPOLE).learn(progress_bar=False)
    tree = agent.tree(prune=False)
    for batch in (np.zeros((0, 4), np.float32), []):
        assert tree.predict(batch).shape == (0,)
        assert tree.apply(batch).shape == (0,)
        assert tree.predict_proba(batch).shape == (0, 2)  # pyright: ignore[reportAttributeAccessIssue]
        assert tree.decision_path(batch).shape == (0, tree.n_nodes)
        assert (tree.with_visits(batch).n_node_samples == 0).all()
        for env in (None, "CartPole-v1"):
            for deterministic in (True, False):
                actions, _ = SymbolicPolicy(tree, env).predict(batch, deterministic=deterministic)
                assert actions.shape == (0,)
