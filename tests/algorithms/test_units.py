"""Features of any unit are learnt from, and what float32 cannot scale ends a training where it begins."""

from __future__ import annotations

from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.envs.errors import EnvironmentFailure
from sympol.types import Step

TRAINING: dict[str, Any] = {
    "num_envs": 8, "num_steps": 32, "depth": 2, "seed": 0, "dynamic_rollout": False, "total_timesteps": 4096,
}  # fmt: skip
SPACE = Box(-np.inf, np.inf, (2,), np.float32)
MOST = 20


class InJax:
    """Pays 1 where the action is the sign of the first feature, and shows both in some unit."""

    observation_space, action_space, max_episode_steps = SPACE, Discrete(2), MOST

    def __init__(self, unit: float) -> None:
        self.unit = np.float32(unit)

    def reset(self, key: Any) -> Any:
        x = jax.random.uniform(key, (2,), minval=-1)
        return (x, jnp.int32(0)), x * self.unit

    def step(self, key: Any, state: Any, action: Any) -> Any:
        x, time = state
        reward = jnp.float32((action == 1) == (x[0] > 0.1))
        x = jax.random.uniform(key, (2,), minval=-1)
        return (x, time + 1), Step(x * self.unit, reward, jnp.bool_(False), time + 1 >= MOST)


class OnHost(gymnasium.Env):
    observation_space, action_space = SPACE, Discrete(2)

    def __init__(self, unit: float) -> None:
        self.unit = unit

    def look(self) -> Any:
        self.x = self.np_random.uniform(-1, 1, 2)
        with np.errstate(over="ignore"):
            return np.float32(self.x * self.unit)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.time = 0
        return self.look(), {}

    def step(self, action: Any) -> Any:
        reward = float((action == 1) == (self.x[0] > 0.1))
        self.time += 1
        return self.look(), reward, False, self.time >= MOST, {}


def made(kind: str, unit: float) -> Any:
    return InJax(unit) if kind == "jax" else lambda: OnHost(unit)


@pytest.mark.parametrize(("kind", "unit"), [("jax", 1e-7), ("jax", 1e-30), ("host", 1e-7)])
def test_the_unit_of_a_feature_does_not_matter(kind: str, unit: float) -> None:
    agent = sympol.PPO("tree", made(kind, unit), num_evals=2, **TRAINING).learn(progress_bar=False)
    assert agent.state is not None
    assert float(agent.state.validation.best_return) > 0.9 * MOST
    tree = agent.tree(prune=False)
    splits = tree.threshold[~tree.is_leaf]
    near = np.concatenate([np.nextafter(splits, np.float32(to)) for to in (-np.inf, np.inf)] + [splits])
    x = np.float32(np.random.default_rng(0).uniform(-1, 1, (2000, 2)) * unit)
    x[: len(near)] = near[:, None]
    values = agent.actor.rollout()(agent.state.normalizer(jnp.asarray(x)))
    np.testing.assert_array_equal(tree.value[tree.apply(x)], np.asarray(values))


def test_a_tree_to_start_from_may_be_of_any_unit() -> None:
    unit = 1e-30
    agent = sympol.PPO("tree", InJax(unit), num_evals=2, **TRAINING).learn(progress_bar=False)
    again = sympol.PPO("tree", InJax(unit), num_evals=2, start=agent.tree(), **TRAINING).learn(
        progress_bar=False
    )
    assert again.state is not None
    assert float(again.state.validation.best_return) > 0.9 * MOST
    assert (np.asarray(again.state.normalizer.scale) > 1e29).all()


@pytest.mark.parametrize(
    ("kind", "unit", "how"),
    [
        ("jax", 2e19, {}),
        ("jax", np.inf, {"threshold_init": "visited"}),
        ("jax", 1e38, {"start": True}),
        ("host", 2e19, {}),
        ("host", 1e38, {}),
    ],
)
def test_what_cannot_be_scaled_ends_the_training_at_once(kind: str, unit: float, how: Any) -> None:
    if how.get("start"):
        small = sympol.PPO("tree", InJax(1.0), num_evals=1, **TRAINING)
        how = {"start": sympol.DecisionTree.from_complete(
            np.array([0]), np.array([0.0]), np.eye(2), actions=small.spec.actions, **small.spec.features.metadata()
        )}  # fmt: skip
    agent = sympol.PPO("tree", made(kind, unit), num_evals=1, **TRAINING, **how)
    with pytest.raises(EnvironmentFailure, match=r"x\[\d\]|not finite") as error:
        agent.learn(progress_bar=False)
    assert "\n" not in str(error.value)
    assert agent.num_timesteps <= 256
    first = "in its first 256 steps the environment returned" if kind == "jax" else "at training step"
    assert first in str(error.value)
