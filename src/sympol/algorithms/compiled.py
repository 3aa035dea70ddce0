"""Functions that are compiled once, ahead of their first call."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import Any

import jax

from ..compilation import in_own_thread
from .memory import require_room

COMPILER_OPTIONS: dict[str, bool | str] = {
    "xla_backend_optimization_level": "1",
    "xla_llvm_disable_expensive_passes": "True",
}
"""Options of LLVM with which it compiles in three fifths of the time; these loops run no slower."""


class Compiled:
    """A function that is compiled once, ahead of its first call, for the shapes of its arguments.

    Args:
        function: The function.
        jit: Keyword arguments of `jax.jit`.
    """

    def __init__(self, function: Callable[..., Any], **jit: Any) -> None:
        self._function, self._executable = jax.jit(function, **jit), None
        self._compiling: Future[Any] | None = None

    def compile(self, *arguments: Any) -> float:
        """Compile for arguments like these, unless that is done, and return the seconds it took."""
        if self._executable is not None:
            return 0.0
        began = time.perf_counter()
        if self._compiling is None:  # otherwise an earlier call was interrupted while it waited
            lowered = self._function.lower(*arguments)
            self._compiling = in_own_thread(lambda: lowered.compile(COMPILER_OPTIONS))
        wait([self._compiling])
        compiling, self._compiling = self._compiling, None
        executable = compiling.result()
        require_room(executable)
        self._executable = executable
        return time.perf_counter() - began

    def __call__(self, *arguments: Any) -> Any:
        """Call the compiled function, compiling it first if necessary."""
        self.compile(*arguments)
        return self._executable(*arguments)  # pyright: ignore[reportOptionalCall]
