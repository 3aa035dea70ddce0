"""The work of a training, known from its config: rollouts, optimizer steps, validation episodes. No JAX is needed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .config import Config
from .growth import stage


def stops(config: Config) -> list[int]:
    """Return the timesteps after which a training validates, reports and is saved."""
    evenly = np.linspace(0, config.total_timesteps, config.num_evals + 1)[1:]
    return sorted({int(np.ceil(stop)) for stop in evenly})


class Work(NamedTuple):
    """The work of a training.

    Attributes:
        rollouts: The number of rollouts.
        optimizer_steps: The number of optimizer steps.
        validations: The number of validations.
        validation_episodes: The number of episodes of all validations together.
    """

    rollouts: int
    optimizer_steps: int
    validations: int
    validation_episodes: int


def work_of(config: Config, teacher: Config | None = None) -> Work:
    """Count what a training with a config does.

    Args:
        config: The config.
        teacher: The config of its teacher, if it has one; distillation is counted as a part of the tree's training.

    Returns:
        The counts; those of another algorithm than PPO count one optimizer step for each rollout. What is used to scale
        features at first is counted as a rollout that is learnt from.
    """
    rollouts, updates = (0, 0) if teacher is None else work_of(teacher)[:2]
    timestep = 0 if teacher is None else teacher.total_timesteps
    while timestep < config.total_timesteps:
        growth = stage(timestep, config.total_timesteps, config.max_stage)
        if config.algorithm == "ppo":
            larger = 1 if config.dynamic_batch else 1 << growth
            updates += config.num_epochs * config.num_minibatches * larger
        else:
            updates += 1
        timestep += config.chunk_size << growth
        rollouts += 1
    return Work(rollouts, updates, config.num_evals, config.num_evals * config.num_eval_episodes)
