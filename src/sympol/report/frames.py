"""Frames of episodes, small enough for a page: reduced, some steps left out, none kept twice."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

from PIL import Image

WIDTH, QUALITY = 320, 50
MOST_BYTES = 200_000
"""Of all pictures in a page; in base64 they are a third larger."""


class Frames:
    """The pictures of one episode, of every ``stride``-th step and of its end."""

    def __init__(self) -> None:
        self._pictures: dict[int, bytes] = {}
        self._last = 0
        self.stride = 1

    def wants(self, step: int) -> bool:
        """Return whether a picture of this step would be kept."""
        return step % self.stride == 0

    def add(self, step: int, picture: Image.Image) -> None:
        """Keep the picture of a step."""
        self._pictures[step], self._last = _encoded(picture), step
        while self.size > MOST_BYTES and self.thin():
            pass

    @property
    def size(self) -> int:
        """Bytes of the pictures, of equal ones once."""
        return sum(map(len, set(self._pictures.values())))

    def thin(self) -> bool:
        """Leave out every second picture; return whether there was one to leave out."""
        before, self.stride = len(self._pictures), 2 * self.stride
        self._pictures = {
            step: picture
            for step, picture in self._pictures.items()
            if step == self._last or self.wants(step)
        }
        return len(self._pictures) < before

    def data(self) -> dict[str, Any]:
        """Return the images, and which of them each step shows: the latest one before it, or its own."""
        images = list(dict.fromkeys(self._pictures.values()))
        position = {image: i for i, image in enumerate(images)}
        shown = 0
        at = []
        for step in range(self._last + 1):
            shown = position.get(self._pictures.get(step, b""), shown)
            at.append(shown)
        return {"images": [_address(image) for image in images], "at": at}


def within_budget(episodes: Sequence[Frames]) -> None:
    """Thin the pictures of episodes until all of them together fit into a page."""
    while sum(frames.size for frames in episodes) > MOST_BYTES:
        if not max(episodes, key=lambda frames: frames.size).thin():
            return


def _encoded(picture: Image.Image) -> bytes:
    width, height = picture.size
    if width > WIDTH:
        picture = picture.resize((WIDTH, round(height * WIDTH / width)), Image.Resampling.BOX)
    file = io.BytesIO()
    picture.convert("RGB").save(file, "WEBP", quality=QUALITY, method=4)
    return file.getvalue()


def _address(image: bytes) -> str:
    return f"data:image/webp;base64,{base64.b64encode(image).decode()}"
