"""Environments that draw themselves, and the frames they draw."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterator

import gymnasium
import numpy as np
from PIL import Image

from ..envs.adapters.gymnasium import EnvironmentFailure
from ..envs.spec import EnvSpec


class CannotRender(ValueError):
    """An environment that draws no pictures; the message says what to do."""


@contextlib.contextmanager
def rendering(spec: EnvSpec) -> Iterator[gymnasium.Env]:
    """Make an environment with ``render_mode="rgb_array"``, and close it afterwards.

    Raises:
        CannotRender: it has no such mode.
    """
    assert spec.make_host is not None
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
    """Return what the environment looks like now. Raises CannotRender if that is no picture."""
    frame = env.render()
    if not isinstance(frame, np.ndarray) or frame.ndim != 3 or frame.shape[2] < 3 or 0 in frame.shape:
        got = f"an array of shape {frame.shape}" if isinstance(frame, np.ndarray) else type(frame).__name__
        raise CannotRender(
            f"{spec.name} does not draw itself as pictures: render() must return an array [height, width, 3], got {got}"
        )
    return Image.fromarray(np.ascontiguousarray(frame[..., :3], dtype=np.uint8))


def _make(spec: EnvSpec) -> gymnasium.Env:
    assert spec.make_host is not None
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
        # it does not take the argument, or not this one, but may have been told already
        return make()


def _remedy(spec: EnvSpec, env: gymnasium.Env) -> str:
    if "rgb_array" not in env.metadata.get("render_modes", ()):
        return f"of the modes in its metadata, {env.metadata.get('render_modes', [])}, none is 'rgb_array'"
    if spec.has_one_copy:
        return "make the object with render_mode='rgb_array'"
    return "let the function that makes it take render_mode='rgb_array' and pass it on"


@contextlib.contextmanager
def _without_display() -> Iterator[None]:
    """Let pygame draw where there is no screen; what the user has chosen stays."""
    if "SDL_VIDEODRIVER" in os.environ:
        yield
        return
    os.environ["SDL_VIDEODRIVER"] = "dummy"
    try:
        yield
    finally:
        os.environ.pop("SDL_VIDEODRIVER", None)
