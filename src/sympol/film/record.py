"""Play episodes and write a film of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
from PIL import Image

from ..envs.spec import EnvSpec
from ..trees import DecisionTree
from .files import check, write
from .frame_layout import FrameLayout, Shot, env_picture
from .rendering import frame_of, rendering, steps

MOST_FRAMES = 300
"""Frames of the longest film; of longer ones every second step is left out, or three of four, …"""
MOST_BYTES = 5_000_000
"""Size of the largest GIF or WebP, which a README or a mail can hold; larger ones leave out steps, too."""
MOST_EPISODES = 100
_FPS, _SLOWEST_FPS, _SECONDS = 30.0, 2.0, 8.0
_HOLD = 1500  # milliseconds


class Recording(NamedTuple):
    """A film, and the episodes in it.

    Attributes:
        path: The file.
        returns: The return of each episode.
        lengths: The steps of each episode.
        frames: Number of frames.
        stride: Steps from one frame to the next.
        size: Size of the file, in bytes.
    """

    path: Path
    returns: list[float]
    lengths: list[int]
    frames: int
    stride: int
    size: int


def record(
    act: Callable[[Any], Any],
    spec: EnvSpec,
    seeds: Sequence[int],
    path: str | PathLike[str],
    *,
    tree: DecisionTree | None = None,
    fps: float | None = None,
    max_steps: int | None = None,
    progress: Callable[[str], None] | None = None,
) -> Recording:
    """Play an episode for each seed, and write a film of all of them.

    Args:
        act: From an observation of the environment to an action that it takes.
        spec: The environment.
        seeds: The seed of each episode.
        path: The file, .gif, .webp or .mp4.
        tree: A tree to show beside the environment, the path of each observation highlighted.
        fps: Steps per second. By default the environment's own pace, at most 30, and slower for episodes too short to
            follow.
        max_steps: Number of steps after which episodes are cut.
        progress: Called with a line of text about what is being done.

    Returns:
        The film.

    Raises:
        ValueError: An argument is out of bounds, or the environment draws no pictures.
        ImportError: The file is an .mp4, and there is no ffmpeg.
        OSError: The file cannot be written.
    """
    path, tell = Path(path), progress or (lambda words: None)
    _check(seeds, fps, max_steps)
    check(path)
    film = _Film()
    with rendering(spec) as env:
        own_fps = float(env.metadata.get("render_fps") or _FPS)
        ended = []
        for episode, seed in enumerate(seeds):
            number = f"episode {episode + 1}/{len(seeds)}   " if len(seeds) > 1 else ""
            ended.append(_play(act, spec, env, seed, film, tree, max_steps, number, tell))
    returns, lengths = [total for total, _ in ended], [steps for _, steps in ended]
    if fps is None:
        fps = min(own_fps, _FPS, max(_SLOWEST_FPS, sum(lengths) / _SECONDS))
    layout = FrameLayout(film.shots[0].frame.size, tree)
    while True:
        times = [_HOLD if shot.is_last else round(1000 * film.stride / fps) for shot in film.shots]
        frames, stride = len(film.shots), film.stride
        size = write(path, _Drawn(layout, film.shots, tell), times)
        if path.suffix.lower() == ".mp4" or size <= MOST_BYTES or not film.thin():
            return Recording(path, returns, lengths, frames, stride, size)
        while size / frames * len(film.shots) > MOST_BYTES and film.thin():
            pass


def _check(seeds: Sequence[int], fps: float | None, max_steps: int | None) -> None:
    if not 1 <= len(seeds) <= MOST_EPISODES:
        raise ValueError(f"episodes must be between 1 and {MOST_EPISODES} in one film, got {len(seeds)}")
    if fps is not None and not 0.1 <= fps <= 50:
        raise ValueError(f"fps must be between 0.1 and 50, got {fps}; viewers of GIFs know no faster ones")
    if max_steps is not None and max_steps < 1:
        raise ValueError(f"max_steps must be at least 1, got {max_steps}")


class _Film:
    """The shots of every ``stride``-th step, and of every episode's end; the stride grows with their number."""

    def __init__(self) -> None:
        self.shots: list[Shot] = []
        self.stride = 1

    def wants(self, step: int) -> bool:
        return step % self.stride == 0

    def add(self, shot: Shot) -> None:
        self.shots.append(shot)
        if len(self.shots) > MOST_FRAMES:
            self.thin()

    def thin(self) -> bool:
        """Leave out every second shot; return whether there was one to leave out."""
        before, self.stride = len(self.shots), 2 * self.stride
        self.shots = [shot for shot in self.shots if shot.is_last or self.wants(shot.step)]
        return len(self.shots) < before


class _Drawn(Sequence[Image.Image]):
    """Pictures that are drawn one at a time: all of them at once would fill the memory."""

    def __init__(self, layout: FrameLayout, shots: Sequence[Shot], tell: Callable[[str], None]) -> None:
        self._layout, self._shots, self._tell = layout, shots, tell

    def __len__(self) -> int:
        return len(self._shots)

    def __getitem__(self, index: Any) -> Any:
        self._tell(f"drawing frame {index + 1:,} of {len(self):,}")
        return self._layout.draw(self._shots[index])


def _play(
    act: Callable[[Any], Any],
    spec: EnvSpec,
    env: gymnasium.Env,
    seed: int,
    film: _Film,
    tree: DecisionTree | None,
    max_steps: int | None,
    number: str,
    tell: Callable[[str], None],
) -> tuple[float, int]:
    """Play one episode; return its return and its length."""
    now = None
    for now in steps(act, spec, env, seed, max_steps):
        if now.end:
            caption = f"{number}{now.end} after {now.step} step{'s' if now.step > 1 else ''}"
            picture = env_picture(frame_of(env, spec))
            film.add(Shot(picture, None, caption, _earned(now.earned), now.step, is_last=True))
        elif film.wants(now.step):
            action = ", ".join(spec.actions.words(now.action, digits=3))
            x = None if tree is None else spec.features.flatten(now.observation)
            picture = env_picture(frame_of(env, spec))
            film.add(
                Shot(picture, x, f"{number}step {now.step + 1}   {action}", _earned(now.earned), now.step)
            )
            tell(f"{number}playing step {now.step + 1:,}")
    assert now is not None
    return now.earned, now.step


def _earned(total: float) -> str:
    return f"return {total:,.2f}"
