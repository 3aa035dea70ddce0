"""Locks that keep two processes from writing the same files; the operating system releases those of dead processes."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
import sys
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Self

from ..files import NO_LINK
from .metadata import RunError

LOCK = ".sympol.lock"
"""The lock's file in a run's folder, there only while the run is written or after its writer was killed."""
WORK_LOCK = ".bench.lock"
"""The lock's file in a folder that holds the work of many processes: a bench, a search."""
_PATIENCE = 0.2
"""Seconds for which a lock is tried: `writer_of` holds it for a moment."""
_HELD_BY_ANOTHER = {errno.EACCES, errno.EAGAIN, errno.EDEADLK}
_NO_LOCKS_HERE = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL}


class Held(Exception):
    """Another process, or another lock of this process, holds the lock; the message names it."""


class Busy(RunError):
    """Another process works in the same folder."""


class NoLocks(UserWarning):
    """The file system has no locks, so nothing keeps two processes from writing the same files."""


class FileLock:
    """A lock on a file, held until `release` or the end of the process; a forked child does not inherit it.

    The file says who holds it, and is removed on release.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor: int | None = None

    def acquire(self, *, wait: bool = False) -> None:
        """Take the lock.

        Args:
            wait: Whether to wait until it is free.

        Raises:
            Held: It is not free, and ``wait`` is False.
            OSError: The file cannot be made.
        """
        deadline = time.monotonic() + _PATIENCE
        while not self._try():
            if not wait and time.monotonic() >= deadline:
                raise Held(_holder(self.path))
            time.sleep(0.02)

    def release(self, *, remove: bool = True) -> None:
        """Release the lock, and remove its file unless ``remove`` is False."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is None or descriptor not in _OPEN:
            return  # it was never taken, or by the process that this one was forked from
        _OPEN.discard(descriptor)
        if remove and _is_still(self.path, descriptor):
            with contextlib.suppress(OSError):
                self.path.unlink()
        os.close(descriptor)

    @property
    def is_held(self) -> bool:
        """Return whether this process holds the lock, and its file is still there."""
        descriptor = self._descriptor
        return descriptor is not None and descriptor in _OPEN and _is_still(self.path, descriptor)

    def __enter__(self) -> Self:
        """Take the lock."""
        self.acquire()
        return self

    def __exit__(self, *_: object) -> None:
        """Release the lock."""
        self.release()

    def _try(self) -> bool:
        descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
        try:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise OSError(errno.EINVAL, "it is not an ordinary file", str(self.path))
            if not _lock(descriptor, self.path) or not _is_still(self.path, descriptor):
                os.close(descriptor)
                return False
        except OSError:
            os.close(descriptor)
            raise
        with contextlib.suppress(OSError):  # on a full disk it does not say who holds it
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode())
        self._descriptor = descriptor
        _OPEN.add(descriptor)
        return True


class FolderLock:
    """The right of this process to write in a folder; it may be taken again where this process has it already.

    Raises:
        Held: Another process writes there.
        OSError: The folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self._key = os.path.realpath(folder)
        with _MUTEX:
            lock, count = _FOLDERS.get(self._key, (None, 0))
            if lock is None or not lock.is_held:
                lock, count = FileLock(folder / LOCK), 0
                lock.acquire()
            self._lock: FileLock | None = lock
            _FOLDERS[self._key] = lock, count + 1

    def release(self, *, remove: bool = True) -> None:
        """Release the lock, once, and remove its file unless ``remove`` is False."""
        with _MUTEX:
            mine, self._lock = self._lock, None
            lock, count = _FOLDERS.get(self._key, (None, 0))
            if mine is None or lock is not mine:
                return
            if count > 1:
                _FOLDERS[self._key] = mine, count - 1
            else:
                del _FOLDERS[self._key]
                mine.release(remove=remove)

    def __del__(self) -> None:
        """Release the lock with the last reference to it."""
        if hasattr(self, "_lock") and not sys.is_finalizing():
            self.release()


@contextlib.contextmanager
def exclusive(folder: Path, what: str, flag: str) -> Iterator[None]:
    """Keep other processes from working in a folder meanwhile; the folder is made if it is missing.

    Args:
        folder: The folder, which holds more than one run.
        what: What works there, for the message: "bench" or "search".
        flag: The command's flag that chooses the folder, for the message.

    Raises:
        Busy: Another process works there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / WORK_LOCK)
    try:
        lock.acquire()
    except Held as holder:
        raise Busy(
            f"another {what} works in {folder}: {holder}; wait for it, or choose another {flag}"
        ) from None
    try:
        yield
    finally:
        lock.release()


@contextlib.contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process of this machine works in a folder, then hold it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder.with_name(f".{folder.name}.lock"))
    lock.acquire(wait=True)
    try:
        yield
    finally:
        lock.release()


def writer_of(folder: Path) -> str | None:
    """Return the other process that writes in a folder, or None."""
    with _MUTEX:
        if os.path.realpath(folder) in _FOLDERS:
            return None
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR | NO_LINK)
    except OSError:
        return None
    try:
        return None if _lock(descriptor, folder / LOCK) else _holder(folder / LOCK)
    finally:
        os.close(descriptor)


_OPEN: set[int] = set()
_FOLDERS: dict[str, tuple[FileLock, int]] = {}
_MUTEX = threading.RLock()


def _forget() -> None:
    """Close, in a forked child, what its parent holds: the lock must not outlive the parent."""
    global _MUTEX
    for descriptor in _OPEN:
        with contextlib.suppress(OSError):
            os.close(descriptor)
    _OPEN.clear()
    _FOLDERS.clear()
    _MUTEX = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _holder(path: Path) -> str:
    try:
        words = path.read_bytes()[:200].decode("utf-8", "replace").split()
    except OSError:
        words = []
    return " ".join(words) or "another process"


def _is_still(path: Path, descriptor: int) -> bool:
    """Return whether an open file still has this name: its holder may have removed it meanwhile."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except OSError:
        return False


def _lock(descriptor: int, path: Path) -> bool:
    """Lock an open file, and return whether it was free."""
    try:
        _lock_now(descriptor)
    except OSError as error:
        if error.errno in _HELD_BY_ANOTHER:
            return False
        if error.errno not in _NO_LOCKS_HERE:
            raise
        warnings.warn(
            f"the file system of {path.parent} has no locks: make sure that no other process writes there",
            NoLocks,
            stacklevel=2,
        )
    return True


if sys.platform == "win32":  # pragma: no cover
    import msvcrt

    def _lock_now(descriptor: int) -> None:
        os.lseek(descriptor, 1000, os.SEEK_SET)  # behind the words that say who holds it
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
else:
    import fcntl

    def _lock_now(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
