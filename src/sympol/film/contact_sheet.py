"""An episode on paper: its frames side by side, from left to right and from the top down."""

from __future__ import annotations

from collections.abc import Sequence

from PIL import Image, ImageDraw

from ..trees.plot_boxes import INK, PAPER
from .frame_layout import font

_GAP, _FONT_SIZE = 10, 13


def strip(
    frames: Sequence[Image.Image], words: Sequence[str], *, columns: int = 6, width: int = 168
) -> Image.Image:
    """Put frames of one size in rows of ``columns``, each ``width`` pixels wide and with a line of words below.

    The picture has few colours: it is meant to be a small PNG. Raises ValueError without frames, or if there are
    not as many words.
    """
    if not frames or len(frames) != len(words):
        raise ValueError(f"there must be words for each frame, got {len(words)} for {len(frames)} frames")
    height = round(width * frames[0].height / frames[0].width)
    row_height = height + _FONT_SIZE + 2 * _GAP
    columns = min(columns, len(frames))
    size = columns * (width + _GAP) + _GAP, -(-len(frames) // columns) * row_height + _GAP
    picture = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(picture)
    for i, (frame, said) in enumerate(zip(frames, words, strict=True)):
        x, y = _GAP + i % columns * (width + _GAP), _GAP + i // columns * row_height
        picture.paste(frame.resize((width, height), Image.Resampling.BOX), (x, y))
        draw.text((x, y + height + _GAP), said, INK, font(_FONT_SIZE), anchor="lm")
    return picture.quantize(64, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
