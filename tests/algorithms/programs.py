"""The small training that most tests look at, compiled once."""

from __future__ import annotations

import functools
from typing import Any

import jax

from sympol.algorithms.config import Config
from sympol.algorithms.state import TrainState
from sympol.algorithms.train_loop import Segment, make_segment
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
    segment, empty = make_segment(env, config.static())
    return jax.jit(segment), empty
