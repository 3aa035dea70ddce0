"""A cache of compiled programs on the disk, so that a second run starts at once."""

from __future__ import annotations

import os
import tempfile
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
from jax._src import xla_bridge  # nothing public tells whether JAX has begun to compute

T = TypeVar("T")


_PROBE = 1 << 20
"""Bytes that must fit on the disk for anything to be kept there: the order of one compiled program."""


def cache_folder() -> Path | None:
    """Return ``$SYMPOL_CACHE_DIR`` or ``~/.cache/sympol``, made if necessary, or None without a usable folder.

    There is none if the variable is empty, the user has no home, or the folder cannot be written. A warning names a
    folder of the user's choice that cannot be written.
    """
    named = os.environ.get("SYMPOL_CACHE_DIR")
    if named == "":
        return None
    try:
        folder = Path.home() / ".cache" / "sympol" if named is None else Path(named)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(_PROBE))
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        if named is not None:
            warnings.warn(
                f"compiled programs are not kept: SYMPOL_CACHE_DIR is {named}, which cannot be written "
                f"({getattr(error, 'strerror', None) or error}); name another folder, or set it to nothing",
                stacklevel=2,
            )
        return None
    return folder


def use_disk_cache() -> None:
    """Keep JAX's programs in the `cache_folder`, unless JAX has its own place.

    Call it before a training; it raises RuntimeError where there can be none (`require_no_fork`).
    """
    require_no_fork()
    if jax.config.jax_compilation_cache_dir is not None:  # pyright: ignore[reportAttributeAccessIssue]
        return
    folder = cache_folder()
    if folder is None:
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def in_own_thread(work: Callable[[], T]) -> Future[T]:
    """Do ``work`` in a thread of its own, which finishes even if the waiting thread is interrupted.

    Where Ctrl-C strikes, JAX stops waiting for a compilation and leaves it to itself. If the process ends then, Python
    takes JAX apart under a thread that still compiles, and the process dies of a segmentation fault. Python waits for
    a thread of its own first; and the next caller gets what it has compiled.
    """
    result: Future[T] = Future()

    def run() -> None:
        try:
            result.set_result(work())
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=run, name="compiling").start()
    return result


def call_in_batches(program: Callable[[Any], Any], arrays: Any, size: int = 512) -> Any:
    """Call a compiled program on the rows of arrays, always on the same number, so that one shape is compiled.

    Args:
        program: A function of a pytree of arrays ``[size, ...]`` that returns another.
        arrays: A pytree of arrays ``[rows, ...]``.
        size: Number of rows in one call; the last call is filled up with the first rows.

    Returns:
        What the program returns, as NumPy arrays ``[rows, ...]``.
    """
    require_no_fork()
    rows = len(jax.tree.leaves(arrays)[0])
    batches = np.resize(np.arange(rows, dtype=np.int32), -(-rows // size) * size).reshape(-1, size)
    parts = [program(jax.tree.map(lambda x, batch=batch: x[batch], arrays)) for batch in batches]
    return jax.tree.map(lambda *x: np.concatenate(x)[:rows], *parts)


_forked = False
"""Whether this process was forked from one in which JAX had begun to compute."""


def _note_fork() -> None:
    global _forked
    _forked = xla_bridge.backends_are_initialized()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


def require_no_fork() -> None:
    """Raise RuntimeError where JAX would wait for ever: its threads stayed behind when this process was forked."""
    if _forked:
        raise RuntimeError(
            "JAX cannot compute in a process that was forked from one in which it had computed; start the process "
            "anew with multiprocessing.get_context('spawn'), or fork before anything is trained (trees need no JAX: "
            "they predict in any process)"
        )
