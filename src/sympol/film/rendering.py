"""Episodes step by step on an environment that draws itself."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from PIL import Image

from ..envs.env import MAX_EPISODE_STEPS
from ..envs.errors import EnvironmentFailure
from ..envs.host import advance, begin
from ..envs.spec import EnvSpec


class Step(NamedTuple):
    """A step of an episode; meanwhile the environment is in the state of ``observation``.

    Attributes:
        step: Number of steps before.
        observation: What the policy observes.
        action: What it does next, or None after the last step.
        earned: The return so far.
        end: ``"terminated"``, ``"truncated"``, or ``"stopped"`` by a limit of steps; empty while the episode runs.
    """

    step: int
    observation: Any
    action: Any
    earned: float
    end: str = ""


def steps(
    act: Callable[[Any], Any],
    spec: EnvSpec,
    env: gymnasium.Env,
    seed: int,
    max_steps: int | None = None,
) -> Iterator[Step]:
    """Play an episode, step by step; the last one is its end.

    Args:
        act: From an observation of the environment to an action that it takes.
        spec: The environment's description, with its limit of steps.
        env: The environment.
        seed: The episode's seed.
        max_steps: A lower limit of steps.
    """
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


class CannotRender(ValueError):
    """An environment that draws no pictures; the message names the remedy."""


@contextlib.contextmanager
def rendering(spec: EnvSpec) -> Iterator[gymnasium.Env]:
    """Make an environment with ``render_mode="rgb_array"``, and close it afterwards.

    Args:
        spec: The environment.

    Raises:
        CannotRender: It has no such mode.
    """
    with _without_display():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Gymnasium warns of what is refused below
            env = _make(spec)
        try:
            if env.render_mode != "rgb_array":
                raise CannotRender(f"{spec.name} does not draw itself as pictures: {_remedy(spec, env)}")
            yield env
        finally:
            if not (spec.has_one_copy and env is spec.make_host()):
                env.close()


def frame_of(env: gymnasium.Env, spec: EnvSpec) -> Image.Image:
    """Return a picture of the environment as it is now.

    Raises:
        CannotRender: It draws something else.
    """
    frame = env.render()
    if not isinstance(frame, np.ndarray) or frame.ndim != 3 or frame.shape[2] < 3 or 0 in frame.shape:
        got = f"an array of shape {frame.shape}" if isinstance(frame, np.ndarray) else type(frame).__name__
        raise CannotRender(
            f"{spec.name} does not draw itself as pictures: render() must return an array [height, width, 3], got {got}"
        )
    return Image.fromarray(np.ascontiguousarray(frame[..., :3], dtype=np.uint8))


def _make(spec: EnvSpec) -> gymnasium.Env:
    make = spec.make_host
    if spec.has_one_copy:
        env = make()
        copies = None if env.render_mode == "rgb_array" else spec.find_copies()
        if copies is None:
            return env
        make = copies  # the object draws nothing, but one that is the same can be made so that it does
    try:
        return make(render_mode="rgb_array")
    except (TypeError, ValueError, AssertionError, EnvironmentFailure):
        # it does not take the argument, or not this value, but may have it already
        return make()


def _remedy(spec: EnvSpec, env: gymnasium.Env) -> str:
    if "rgb_array" not in env.metadata.get("render_modes", ()):
        return f"of the modes in its metadata, {env.metadata.get('render_modes', [])}, none is 'rgb_array'"
    if spec.has_one_copy:
        return "make the object with render_mode='rgb_array'"
    return "let the function that makes it take render_mode='rgb_array' and pass it on"


@contextlib.contextmanager
def _without_display() -> Iterator[None]:
    """Let pygame draw without a screen, unless the user has chosen a driver."""
    if "SDL_VIDEODRIVER" in os.environ:
        yield
        return
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    try:
        yield
    finally:
        os.environ.pop("SDL_VIDEODRIVER", None)
