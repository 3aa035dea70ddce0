"""Compiled programs, kept on disk: the second run starts at once."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

import jax

T = TypeVar("T")


def cache_folder() -> Path | None:
    """``$SYMPOL_CACHE_DIR`` or ``~/.cache/sympol``; None where that variable is empty, and nothing is kept."""
    folder = os.environ.get("SYMPOL_CACHE_DIR", str(Path.home() / ".cache" / "sympol"))
    return Path(folder) if folder else None


def use_disk_cache() -> None:
    """Keep JAX's programs in the `cache_folder`, unless JAX has its own place."""
    folder = cache_folder()
    if folder is None or jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def in_own_thread(work: Callable[[], T]) -> Future[T]:
    """Do ``work`` in a thread of its own, which comes to its end even if whoever waits for it is interrupted.

    Where Ctrl-C strikes, JAX stops waiting for a compilation and leaves it to itself. If the process ends then, Python
    takes JAX apart under a thread that still compiles, and the process dies of a segmentation fault. Python waits for
    a thread of its own first; and whoever asks again, gets what it has compiled.
    """
    result: Future[T] = Future()

    def run() -> None:
        try:
            result.set_result(work())
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=run, name="compiling").start()
    return result
