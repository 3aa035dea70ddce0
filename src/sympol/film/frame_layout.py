"""One picture of a film: the environment on the left, the tree on the right, a line of text below."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ..trees import DecisionTree
from ..trees.floats import printable
from ..trees.plot import PathPictures
from ..trees.plot_boxes import INK, PAPER

# pixels
_ENV, _TREE = (480, 480), (760, 660)
_SMALLEST_ENV = 240
_MARGIN, _CAPTION, _FONT_SIZE = 12, 34, 17
_DPI = 92.0
LARGEST_TREE = 500
"""Nodes of the largest tree that is drawn; a larger one could not be read."""


class Shot(NamedTuple):
    """The content of one picture.

    Attributes:
        frame: The environment, as large as `env_picture` makes it.
        observation: The observation whose path is highlighted, [features]; None shows the whole tree.
        caption: The text below on the left.
        earned: The text below on the right.
        step: The step of the episode.
        is_last: Whether it is the end of its episode.
    """

    frame: Image.Image
    observation: np.ndarray | None
    caption: str
    earned: str
    step: int
    is_last: bool = False


def env_picture(frame: Image.Image) -> Image.Image:
    """Resize a frame of an environment; small ones by a whole number, so that pixels stay squares."""
    width, height = frame.size
    if max(width, height) <= _SMALLEST_ENV:
        times = -(-_SMALLEST_ENV // max(width, height))
        return frame.resize((width * times, height * times), Image.Resampling.NEAREST)
    scale = min(1.0, _ENV[0] / width, _ENV[1] / height)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return frame if scale == 1 else frame.resize(size, Image.Resampling.HAMMING)


@cache
def font(size: int) -> ImageFont.FreeTypeFont:
    """Return Matplotlib's own font: it has arrows and ≤, and is the same everywhere."""
    import matplotlib

    file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(file), size, layout_engine=ImageFont.Layout.BASIC)


class FrameLayout:
    """Draws shots, all of one size: the environment on the left, the tree on the right, a line of text below.

    The tree is drawn once for each leaf that an episode reaches. A tree of more than `LARGEST_TREE` nodes is left out.

    Args:
        env_size: Width and height of the environment's pictures.
        tree: The tree, if one is to be shown.
    """

    def __init__(self, env_size: tuple[int, int], tree: DecisionTree | None) -> None:
        self._env_size, self._tree = env_size, tree if tree and tree.n_nodes <= LARGEST_TREE else None
        self._paths = PathPictures(self._tree, most_pixels=_TREE, dpi=_DPI) if self._tree else None
        self._pictures: dict[int, Image.Image] = {}
        tree_size = self._paths.size if self._paths else (0, 0)
        width = env_size[0] + 2 * _MARGIN + (tree_size[0] + _MARGIN if self._paths else 0)
        # room for the text where the environment is narrow
        width, height = max(width, 360), max(env_size[1], tree_size[1]) + 2 * _MARGIN + _CAPTION
        self.size = width + width % 2, height + height % 2  # films in colour are made of blocks of 2 × 2

    def draw(self, shot: Shot) -> Image.Image:
        """Return the picture of a shot."""
        picture = Image.new("RGB", self.size, PAPER)
        width, height = self.size
        body = height - _CAPTION
        tree = self._tree_picture(shot.observation)
        frame = shot.frame if shot.frame.size == self._env_size else shot.frame.resize(self._env_size)
        left = _MARGIN if tree is not None else (width - frame.width) // 2
        picture.paste(frame, (left, (body - frame.height) // 2))
        if tree is not None:
            picture.paste(tree, (2 * _MARGIN + frame.width, (body - tree.height) // 2))
        self._write(picture, shot)
        return picture

    def _write(self, picture: Image.Image, shot: Shot) -> None:
        draw, (width, height) = ImageDraw.Draw(picture), self.size
        y = height - _MARGIN - _CAPTION // 4
        earned = self._fitting(shot.earned, width // 2)
        room = width - 3 * _MARGIN - self._font.getlength(earned)
        draw.text((_MARGIN, y), self._fitting(shot.caption, room), INK, self._font, anchor="lm")
        draw.text((width - _MARGIN, y), earned, INK, self._font, anchor="rm")

    def _fitting(self, words: str, width: float) -> str:
        words = printable(words)[:200]
        while len(words) > 1 and self._font.getlength(words) > width:
            words = words[:-2] + "…"
        return words

    @property
    def _font(self) -> ImageFont.FreeTypeFont:
        return font(_FONT_SIZE)

    def _tree_picture(self, observation: np.ndarray | None) -> Image.Image | None:
        if self._tree is None or self._paths is None:
            return None
        leaf = -1 if observation is None else int(self._tree.apply(observation))
        if leaf not in self._pictures:
            self._pictures[leaf] = Image.fromarray(
                self._paths.whole() if leaf < 0 else self._paths.path_to(leaf)
            )
        return self._pictures[leaf]
