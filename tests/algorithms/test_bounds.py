"""Observations outside their space: said once, and nothing is pruned by a bound that does not hold."""

import warnings
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

import sympol
from sympol.algorithms.normalization import OutsideBounds
from sympol.types import Step

from ..tiny import TINY, quick_compiles

__all__ = ["quick_compiles"]


class Liar(gymnasium.Env):
    """Promises [-1, 1]; the second feature comes as low as -3, the third never leaves."""

    def __init__(self) -> None:
        self.observation_space = Box(-1, 1, (3,))
        self.action_space = Discrete(2)

    def _look(self) -> np.ndarray:
        first, second, third = self.np_random.uniform(-1, 1, 3)
        return np.array([first, second * 2 - 1, third], np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.time = 0
        return self._look(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.time += 1
        return self._look(), float(action), False, self.time >= 8, {}


@dataclass(frozen=True)
class LiarInJax:
    """The same, written in JAX; its last observation alone may break the promise."""

    last: float
    max_episode_steps: int = 4

    @property
    def observation_space(self) -> Box:
        return Box(-1, 1, (2,))

    @property
    def action_space(self) -> Discrete:
        return Discrete(2)

    def reset(self, key: Any) -> tuple[Any, Any]:
        import jax

        return jax.numpy.int32(0), jax.random.uniform(key, (2,), minval=-1.0)

    def step(self, key: Any, state: Any, action: Any) -> tuple[Any, Step]:
        import jax
        import jax.numpy as jnp

        x = jax.random.uniform(key, (2,), minval=-1.0)
        done = state + 1 >= self.max_episode_steps
        x = jnp.where(done, x.at[1].set(self.last), x)
        return state + 1, Step(x, jnp.float32(1), jnp.bool_(False), done)


@pytest.mark.parametrize("trust_bounds", [True, False])
def test_a_broken_bound_is_said_once_and_not_pruned_by(trust_bounds):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        agent = sympol.PPO("tree", Liar, trust_bounds=trust_bounds, **TINY).learn(progress_bar=False)
    said = [str(w.message) for w in caught if w.category is OutsideBounds]
    assert len(said) == 1
    assert "outside its observation space, in 'x[1]';" in said[0]
    tree = agent.tree()
    np.testing.assert_array_equal(tree.feature_low, [-1, -np.inf, -1])
    np.testing.assert_array_equal(tree.feature_high, [1, 1, 1])


@pytest.mark.parametrize(("last", "high"), [(1.0, 1.0), (1.0000001, np.inf)])
def test_the_last_observation_of_an_episode_counts_to_the_last_digit(last, high):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        agent = sympol.PPO("tree", LiarInJax(last), normalize_obs=False, **TINY).learn(progress_bar=False)
    assert [w.category for w in caught] == [OutsideBounds] * (high > 1)
    np.testing.assert_array_equal(agent.tree().feature_high, np.float32([1, high]))
