"""Files that are written whole or not at all, and files of strangers that are read up to a size.

Everything that sympol writes passes `write` or `append`. A new file gets a name that nobody can predict and is renamed
when it is complete, so that a process killed at any moment leaves the old file or the new one. A symbolic link is never
written through: it is replaced, and what it points to stays as it is.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

_TEMPORARY = re.compile(r"\.sympol-(\d+)-[0-9a-f]{16}\.tmp")
"""Names of unfinished files, with the number of the process that writes them."""
_NO_WAIT = sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_BINARY", "O_NONBLOCK"))
"""Opening a pipe does not wait for its other end."""
NO_LINK = _NO_WAIT | getattr(os, "O_NOFOLLOW", 0)
"""Opening a symbolic link fails, too."""
MOST = 2**26
"""The size, in bytes, of the largest text that is read: 64 MiB, which is more than any file that sympol writes."""


def write(path: Path, content: str | bytes) -> None:
    """Write a file that is either the old one or the whole new one, at any moment.

    It is on the disk when this returns. It has the permissions of the file that it replaces, or those that the umask
    leaves. A device or a pipe, such as ``/dev/stdout``, is written to directly.

    Args:
        path: The file.
        content: Its content; text is written as UTF-8.

    Raises:
        OSError: It cannot be written; ``filename`` is ``path``.
    """
    content = content.encode() if isinstance(content, str) else content
    with _named(path):
        if _is_special(path):
            with open(path, "wb") as file:
                file.write(content)
            return
        temporary = path.with_name(f".sympol-{os.getpid()}-{secrets.token_hex(8)}.tmp")
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK, 0o666)
        try:
            with open(descriptor, "wb") as file:
                _keep_mode(path, descriptor)
                file.write(content)
                file.flush()
                os.fsync(descriptor)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def append(path: Path, content: str | bytes) -> None:
    """Append to a file, which is made if necessary; all of it, or nothing if that fails.

    Args:
        path: The file.
        content: What to append; text is written as UTF-8.

    Raises:
        OSError: It cannot be written; ``filename`` is ``path``.
    """
    content = content.encode() if isinstance(content, str) else content
    if path.is_symlink():
        write(path, (read_bytes(path, MOST) if path.exists() else b"") + content)
        return
    with _named(path):
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | NO_LINK, 0o666)
        with open(descriptor, "ab", buffering=0) as file:
            before = os.fstat(descriptor).st_size
            try:
                written = file.write(content)
                while written < len(content):
                    written += file.write(content[written:])
            except OSError:
                with contextlib.suppress(OSError):
                    os.ftruncate(descriptor, before)
                raise


def read_text(path: Path, most: int = MOST) -> str:
    """Return a text in UTF-8, with or without a byte-order mark; line breaks become ``\\n``.

    Args:
        path: The file.
        most: Its largest size, in bytes.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no ordinary file, larger, or not UTF-8.
    """
    try:
        text = read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"it is not text in UTF-8 (byte {error.start:,} is wrong)") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a file.

    Args:
        path: The file.
        most: Its largest size, in bytes.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no ordinary file (reading a pipe might never end), or larger.
    """
    descriptor = os.open(path, os.O_RDONLY | _NO_WAIT)
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode):
        os.close(descriptor)
        raise ValueError("it is not an ordinary file")
    with open(descriptor, "rb") as file:
        if found.st_size > most:
            raise ValueError(
                f"the file is larger than {most / 2**20:.3g} MiB, which is the most that is read"
            )
        return file.read(most)


def is_temporary(name: str) -> bool:
    """Return whether a file of this name is an unfinished one of this or an earlier version of sympol."""
    return bool(_TEMPORARY.fullmatch(name)) or (name.startswith(".") and name.endswith((".tmp", ".tmp.svg")))


def remove_temporaries(folder: Path) -> None:
    """Remove the unfinished files of processes that have ended."""
    for file in folder.iterdir() if folder.is_dir() else ():
        found = _TEMPORARY.fullmatch(file.name)
        if found and not _is_alive(int(found[1])):
            file.unlink(missing_ok=True)


def _is_alive(process: int) -> bool:
    if os.name != "posix" or process == os.getpid():
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True  # it is another user's
    return True


def _is_special(path: Path) -> bool:
    """Return whether a path is a device, a pipe, or a name that only the system gives, such as ``/dev/stdout``."""
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    folder = Path(os.path.realpath(path.parent))
    return (
        not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))
        or folder == Path("/dev")
        or folder.parts[1:2] == ("proc",)
    )


def _keep_mode(path: Path, descriptor: int) -> None:
    """Give a new file the permissions of the one it is to replace."""
    with contextlib.suppress(OSError, AttributeError):
        there = path.lstat().st_mode
        if stat.S_ISREG(there):
            os.fchmod(descriptor, stat.S_IMODE(there))


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Make every OSError in the block name the file itself, not a temporary one."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
