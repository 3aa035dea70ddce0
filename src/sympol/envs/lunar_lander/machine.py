"""Machine code that Numba compiles of plain Python functions and keeps on disk.

Numba recompiles a function whose own file has changed, but not one that calls functions of a changed file. So the
folder of the cache is named after a hash of all files of this package.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba.core.config
from numba import njit
from numba.core.cgutils import get_null_value
from numba.extending import intrinsic

from ...compilation import cache_folder


def _folder() -> str:
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    folder = cache_folder()
    return str(folder / f"numba-{digest.hexdigest()[:16]}") if folder else ""


_FOLDER = _folder()
_config: Any = numba.core.config


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function when it is first called.

    float32 stays float32, operations are not reordered, a division by zero raises nothing, and other threads may run
    meanwhile.
    """
    before, _config.CACHE_DIR = _config.CACHE_DIR, _FOLDER
    try:
        dispatcher: Any = njit(cache=bool(_FOLDER), error_model="numpy", nogil=True)(function)
    finally:
        _config.CACHE_DIR = before
    if _FOLDER:
        _ignore_disk_errors(dispatcher._cache)
    return dispatcher


def _ignore_disk_errors(cache: Any) -> None:
    """Make a cache ignore errors of the disk, because what is compiled can run without being kept."""

    def forgiving(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            with contextlib.suppress(OSError):
                return method(*arguments)
            return None  # nothing is kept

        return call

    cache.load_overload, cache.save_overload = forgiving(cache.load_overload), forgiving(cache.save_overload)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a function into its callers, so that a loop around the call can take several numbers at a time."""
    return njit(error_model="numpy", inline="always")(function)


def _borrowed(typing_context: Any, array: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = get_null_value(view.meminfo.type)
        view.parent = get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), code


borrowed: Any = intrinsic(_borrowed)
"""The same array without a reference count, which Numba updates atomically at every access; that took two fifths of a
step. The owner must keep the array alive meanwhile, so only arrays made in Python may be borrowed."""
