"""Machine code, made by Numba of plain Python functions and kept on disk.

Numba looks at the file of a function to see whether what it kept is stale, and not at those of the functions that it
calls. So the place is named after all files of this package.
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
    """The function as machine code, made when it is first called: float32 stays float32, nothing is reordered, and a
    division by zero is none of Python's affairs. Others may run meanwhile."""
    kept, _config.CACHE_DIR = _config.CACHE_DIR, _FOLDER
    try:
        dispatcher: Any = njit(cache=bool(_FOLDER), error_model="numpy", nogil=True)(function)
    finally:
        _config.CACHE_DIR = kept
    if _FOLDER:
        _keep_if_possible(dispatcher._cache)
    return dispatcher


def _keep_if_possible(cache: Any) -> None:
    """A disk that has become full, or was taken away, is no reason not to run what has been compiled."""

    def forgiving(method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            with contextlib.suppress(OSError):
                return method(*arguments)
            return None  # nothing is kept

        return call

    cache.load_overload, cache.save_overload = forgiving(cache.load_overload), forgiving(cache.save_overload)


def inlined(function: Callable[..., Any]) -> Any:
    """As `compiled`, and written into whoever calls it: only then a loop around the call can take several numbers at a
    time."""
    return njit(error_model="numpy", inline="always")(function)


def _lent(typing_context: Any, array: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = get_null_value(view.meminfo.type)
        view.parent = get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), code


lent: Any = intrinsic(_lent)
"""The same array, without a count of who holds it: Numba counts at every look into one, atomically, which took two
fifths of a step. Who lends an array has to hold it meanwhile: only what was made in Python may be lent."""
