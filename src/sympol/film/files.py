"""Films as files: GIF and WebP by Pillow, MP4 by ffmpeg."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from .. import files

_PALETTE_FROM = 24
"""Number of pictures from which the colours of a GIF are chosen."""
_COLOURS, _EXACT_COLOURS = 255, 64


class NoCodec(ImportError):
    """The program that writes a film is not installed; the message has the command that installs it."""


def check(path: Path) -> None:
    """Refuse a file that cannot be written, before any episode is played.

    Raises:
        ValueError: The suffix is that of no format.
        NoCodec: It is an .mp4, and there is no ffmpeg.
        OSError: The folder does not exist.
    """
    if path.suffix.lower() not in _WRITERS:
        raise ValueError(f"a film is saved as {', '.join(_WRITERS)}, got {str(path)!r}")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent}")
    if path.suffix.lower() == ".mp4":
        _ffmpeg()


def write(path: Path, pictures: Sequence[Image.Image], milliseconds: Sequence[int]) -> int:
    """Write a film. The same pictures give the same file, except for MP4s of different encoders.

    Args:
        path: The file, which is written whole or not at all.
        pictures: Pictures of one size.
        milliseconds: How long each of them is shown.

    Returns:
        The size of the file, in bytes.

    Raises:
        OSError: It cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="sympol-film-") as folder:
        drawn = Path(folder, path.name)
        _WRITERS[path.suffix.lower()](drawn, pictures, milliseconds)
        content = drawn.read_bytes()
    files.write(path, content)
    return len(content)


def _write_gif(path: Path, pictures: Sequence[Image.Image], milliseconds: Sequence[int]) -> None:
    palette = _palette(pictures)
    carrier = Image.new("P", (1, 1))
    carrier.putpalette(bytes(sum(palette, ())))
    first, *rest = (p.quantize(palette=carrier, dither=Image.Dither.NONE) for p in pictures)
    # times are written in hundredths of a second, and viewers take less than two of them for a mistake
    times = [max(20, round(time / 10) * 10) for time in milliseconds]
    first.save(
        path,
        "GIF",
        save_all=True,
        append_images=rest,
        duration=times,
        loop=0,
        disposal=1,
        palette=bytes(sum(palette, ())),
        transparency=len(palette) - 1,
        optimize=True,  # what stays as it was is written as transparent
    )


def _palette(pictures: Sequence[Image.Image]) -> list[tuple[int, ...]]:
    """Return one palette for all pictures: a palette for each would be larger, and flicker.

    The most frequent colours are exact, white above all. The last one is in no picture, and stands for transparency.
    """
    chosen = range(0, len(pictures), -(-len(pictures) // _PALETTE_FROM))
    width, height = pictures[0].size
    sheet = Image.new("RGB", (width, height * len(chosen)))
    for i, which in enumerate(chosen):
        sheet.paste(pictures[which], (0, i * height))
    counted: Any = sheet.getcolors(2**24)
    exact = [colour for _, colour in sorted(counted, reverse=True)[:_EXACT_COLOURS]]
    rest = sheet.quantize(_COLOURS - len(exact), Image.Quantize.MEDIANCUT).getpalette() or []
    others = list(zip(rest[::3], rest[1::3], rest[2::3], strict=True))
    palette: list[tuple[int, ...]] = []
    for colour in (*exact, *others):
        # Pillow looks colours up by their first six bits: of two that share them it may take the wrong one
        if all(max(abs(a - b) for a, b in zip(colour, kept, strict=True)) > 8 for kept in palette):
            palette.append(colour)
    return [*palette, next((0, i, 255) for i in range(256) if (0, i, 255) not in palette)]


def _write_webp(path: Path, pictures: Sequence[Image.Image], milliseconds: Sequence[int]) -> None:
    first, *rest = pictures
    first.save(
        path,
        "WEBP",
        save_all=True,
        append_images=rest,
        duration=list(milliseconds),
        loop=0,
        quality=75,
        method=3,
    )


def _write_mp4(path: Path, pictures: Sequence[Image.Image], milliseconds: Sequence[int]) -> None:
    # a constant rate plays everywhere: what is shown longer is there more than once
    tick = min(milliseconds)
    width, height = pictures[0].size
    source = f"-f rawvideo -pix_fmt rgb24 -video_size {width}x{height} -framerate {1000 / tick:.4f} -i pipe:0"
    coded = (
        "-an -c:v libx264 -crf 20 -pix_fmt yuv420p -movflags +faststart -fflags +bitexact -flags:v +bitexact"
    )
    with tempfile.TemporaryFile() as log:
        with warnings.catch_warnings():
            # JAX warns of any fork; the child becomes ffmpeg at once and touches nothing of JAX
            warnings.filterwarnings("ignore", r"os\.fork\(\) was called", RuntimeWarning)
            command = [_ffmpeg(), "-y", "-loglevel", "error", *source.split(), *coded.split(), str(path)]
            running = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=log, stderr=log)
        with contextlib.suppress(BrokenPipeError), running:  # if it breaks, it says why below
            assert running.stdin is not None
            for picture, time in zip(pictures, milliseconds, strict=True):
                running.stdin.write(picture.tobytes() * max(1, round(time / tick)))
        if running.returncode:
            log.seek(0)
            words = log.read().decode(errors="replace").strip()
            raise OSError(f"ffmpeg could not write {path.name}: {words}")


def _ffmpeg() -> str:
    """Return the user's own ffmpeg, or that of the package imageio-ffmpeg."""
    if (program := shutil.which("ffmpeg")) is not None:
        return program
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise NoCodec(
            "an .mp4 needs ffmpeg, which is not installed; install it: pip install 'sympol[video]', or choose a "
            ".gif or .webp"
        ) from error


_WRITERS: dict[str, Callable[[Path, Sequence[Image.Image], Sequence[int]], None]] = {
    ".gif": _write_gif,
    ".webp": _write_webp,
    ".mp4": _write_mp4,
}
