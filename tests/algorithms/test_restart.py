"""Only what ended starts again, with the same key and to the same state, whatever the size of the blocks."""

from __future__ import annotations

from typing import Any

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sympol.algorithms.restart import MOST_BLOCKS, block_size, restart
from sympol.envs.classic.cartpole import CartPole
from sympol.envs.minigrid import make
from sympol.types import Step


class Generated:
    """A world whose start takes a large random map."""

    observation_space = gymnasium.spaces.Box(0, 1, (1,), np.float32)
    action_space = gymnasium.spaces.Discrete(2)

    def reset(self, key: Any) -> tuple[Any, Any]:
        world = jax.random.uniform(key, (400, 400))
        return world[0], world[:1, 0]

    def step(self, key: Any, state: Any, action: Any) -> tuple[Any, Step]:
        return state, Step(state[:1], jnp.float32(0), jnp.bool(False), jnp.bool(False))


@pytest.mark.parametrize("ended", [[], [3], [0, 1, 5, 9], range(10)])
@pytest.mark.parametrize("block", [1, 3, 4, 10])
def test_what_ended_starts_with_its_own_key(ended: Any, block: int) -> None:
    env, keys = CartPole(), jax.random.split(jax.random.key(1), 10)
    before = jax.vmap(env.reset)(jax.random.split(jax.random.key(2), 10))
    fresh = jax.vmap(env.reset)(keys)
    done = np.isin(np.arange(10), ended)
    after = jax.jit(lambda m, d: restart(env, d, keys, m, block))(before, done)
    for now, new, old in zip(*map(jax.tree.leaves, (after, fresh, before)), strict=True):
        np.testing.assert_array_equal(now, np.where(done.reshape(-1, *[1] * (now.ndim - 1)), new, old))


def test_blocks_are_for_expensive_resets_alone() -> None:
    assert block_size(CartPole(), 64) == 64
    assert block_size(make("MiniGrid-FourRooms-v0"), 64) == 64
    assert block_size(Generated(), 64) == 64 // MOST_BLOCKS
    assert block_size(Generated(), 8) == 1
