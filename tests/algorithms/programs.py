"""The small training that most tests look at, compiled once."""

from __future__ import annotations

import functools
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
from gymnasium.spaces import Box

from sympol.algorithms.config import Config
from sympol.algorithms.loop import Loop, Segment
from sympol.algorithms.registry import algorithm_class
from sympol.algorithms.state import TrainState
from sympol.algorithms.trainer import make_loop
from sympol.envs.classic.cartpole import CartPole

CARTPOLE = CartPole(max_episode_steps=11)
CONFIG = Config(
    depth=2,
    num_envs=2,
    num_steps=16,
    total_timesteps=8 * 128 * 32,
    minibatch_size=16,
    num_epochs=2,
    critic_hidden=(4,),
    num_evals=4,
    num_eval_episodes=3,
    weight_decay=0.1,
)
"""Eight stages: rollouts of 32 to 4096 samples."""


@functools.cache
def segment_of(env: Any, config: Config) -> tuple[Segment, TrainState]:
    loop = make_loop(env, config.static())
    return jax.jit(loop.segment), loop.template()


def state_with(config: Config, distribution: Any, normalizer: Any, seed: int = 0) -> TrainState:
    """A new state for features that have this scale already, without environments or metrics."""
    num_features = normalizer.shift.shape[0]
    source: Any = SimpleNamespace(
        bounds=Box(-1, 1, (num_features,)),
        compiled=lambda function, ahead=False: function,
        reset=lambda state: state,
    )
    algorithm = algorithm_class(config.algorithm)(config, distribution, num_features)
    loop = Loop(config, algorithm, source)
    state = loop.begin(config.hyperparameters(), jnp.uint32(seed), loop.template())
    return state._replace(normalizer=normalizer)


def begun(source: Any, config: Config, seed: int = 0) -> TrainState:
    """A state before the first step."""
    loop = make_loop(source, config.static())
    return jax.jit(loop.begin)(config.hyperparameters(), jnp.uint32(seed), loop.template())
