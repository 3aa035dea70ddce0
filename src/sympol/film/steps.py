"""One episode step by step, for everyone who shows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium

from ..envs.adapters.gymnasium import advance, begin
from ..envs.env import MAX_EPISODE_STEPS
from ..envs.spec import EnvSpec


class Step(NamedTuple):
    """Where an episode stands: the environment is as it was when ``observation`` was made."""

    step: int
    """How many there were before."""
    observation: Any
    action: Any
    """What is done next; None where the episode has ended."""
    earned: float
    """The return so far."""
    end: str = ""
    """``"terminated"``, ``"truncated"``, or ``"stopped"`` by a limit of ours."""


def steps(
    act: Callable[[Any], Any],
    spec: EnvSpec,
    env: gymnasium.Env,
    seed: int,
    max_steps: int | None = None,
) -> Iterator[Step]:
    """Play an episode on ``env`` with what ``act`` answers to each observation; the last step is its end."""
    observation = begin(env, seed=seed)
    limit = min(max_steps or MAX_EPISODE_STEPS, spec.max_episode_steps or MAX_EPISODE_STEPS)
    total, step, end = 0.0, 0, ""
    while not end:
        action = act(observation)
        yield Step(step, observation, action, total)
        observation, reward, terminated, truncated = advance(env, action)
        total, step = total + reward, step + 1
        if terminated or truncated or step >= limit:
            end = "terminated" if terminated else "truncated" if truncated else "stopped"
    yield Step(step, observation, None, total, end)
